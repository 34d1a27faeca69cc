"""The parameters: PX4's names, types and defaults, and a table of values that passes changes to the compiled core.

An int default means INT32, a float default REAL32. Source of names and values: the PX4 parameter reference. The
compiled core replaces the defaults of its gains (MC_*, MPC_*) by values for the airframe.
"""

import json
import math
import struct
from collections.abc import Callable, Mapping
from pathlib import Path

from foundation.errors import UsageError
from foundation.files import write_text
from foundation.typed_file import file_bytes, json_of, typed

DEFAULTS: dict[str, int | float] = {
    # identity
    "SYS_AUTOSTART": 10040, "SYS_AUTOCONFIG": 0, "SYS_HITL": 0, "SYS_FAILURE_EN": 0, "SYS_HAS_GPS": 1,
    "SYS_HAS_MAG": 1, "SYS_HAS_BARO": 1, "SYS_HAS_NUM_ASPD": 0, "SYS_MC_EST_GROUP": 2, "MAV_SYS_ID": 1,
    "MAV_COMP_ID": 1, "MAV_TYPE": 2, "MAV_PROTO_VER": 0, "MAV_FWDEXTSP": 1, "CAL_ACC0_ID": 1310988,
    "CAL_GYRO0_ID": 1310988, "CAL_MAG0_ID": 197388, "SENS_BOARD_ROT": 0, "CBRK_FLIGHTTERM": 121212,
    "CBRK_SUPPLY_CHK": 894281, "CBRK_USB_CHK": 197848, "CBRK_IO_SAFETY": 22027,
    # arming and disarming
    "COM_ARM_AUTH_REQ": 0, "COM_ARM_BAT_MIN": -1.0, "COM_ARM_WO_GPS": 1, "COM_ARM_SWISBTN": 0, "COM_ARM_MAG_STR": 2,
    "COM_ARMABLE": 1, "COM_DISARM_LAND": 2.0, "COM_DISARM_PRFLT": 10.0, "COM_DISARM_MAN": 1, "COM_SPOOLUP_TIME": 1.0,
    "COM_HOME_EN": 1, "COM_HOME_IN_AIR": 0, "COM_PREARM_MODE": 0, "COM_TAKEOFF_ACT": 0, "COM_FLTMODE1": -1,
    "COM_FLTMODE2": -1, "COM_FLTMODE3": -1, "COM_FLTMODE4": -1, "COM_FLTMODE5": -1, "COM_FLTMODE6": -1,
    "COM_FLIGHT_UUID": 0, "COM_CPU_MAX": 95.0, "COM_POWER_COUNT": 1,
    # failsafes
    "COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0, "COM_RCL_EXCEPT": 0, "COM_RC_IN_MODE": 3, "COM_RC_LOSS_T": 0.5,
    "COM_RC_OVERRIDE": 1, "COM_RC_STICK_OV": 30.0, "COM_DL_LOSS_T": 10, "COM_DLL_EXCEPT": 0, "COM_FAIL_ACT_T": 5.0,
    "COM_LOW_BAT_ACT": 0, "COM_FLT_TIME_MAX": -1, "COM_FLTT_LOW_ACT": 3, "COM_POS_FS_EPH": 5.0, "COM_VEL_FS_EVH": 1.0,
    "COM_POSCTL_NAVL": 0, "COM_WIND_MAX": -1.0, "COM_WIND_MAX_ACT": 0, "COM_WIND_WARN": -1.0, "COM_ACT_FAIL_ACT": 0,
    "COM_IMB_PROP_ACT": 0, "COM_GNSSLOSS_ACT": 0, "COM_MOT_TEST_EN": 1, "COM_OBC_LOSS_T": 5.0, "NAV_RCL_ACT": 2,
    "COM_LKDOWN_TKO": 3.0,
    "NAV_DLL_ACT": 0, "NAV_ACC_RAD": 10.0, "NAV_MC_ALT_RAD": 0.8, "NAV_LOITER_RAD": 80.0, "NAV_FORCE_VT": 1,
    "NAV_TRAFF_AVOID": 1, "GF_ACTION": 2, "GF_MAX_HOR_DIST": 0.0, "GF_MAX_VER_DIST": 0.0, "GF_SOURCE": 0,
    "GF_PREDICT": 0, "FD_FAIL_P": 60, "FD_FAIL_R": 60, "FD_FAIL_P_TTRI": 0.3, "FD_FAIL_R_TTRI": 0.3,
    "FD_ACT_EN": 1, "FD_ESCS_EN": 1, "BAT_LOW_THR": 0.15, "BAT_CRIT_THR": 0.07, "BAT_EMERGEN_THR": 0.05,
    "BAT1_N_CELLS": 4, "BAT1_V_CHARGED": 4.05, "BAT1_V_EMPTY": 3.6, "BAT1_CAPACITY": -1.0, "BAT1_R_INTERNAL": -1.0,
    "BAT1_SOURCE": 0, "BAT_AVRG_CURRENT": 15.0,
    # automatic flight
    "MIS_TAKEOFF_ALT": 2.5, "MIS_DIST_1WP": 10000.0, "MIS_YAW_TMT": -1.0, "MIS_YAW_ERR": 12.0, "MIS_TKO_LAND_REQ": 0,
    "RTL_RETURN_ALT": 60.0, "RTL_DESCEND_ALT": 30.0, "RTL_LAND_DELAY": 0.0, "RTL_MIN_DIST": 10.0, "RTL_TYPE": 0,
    "RTL_CONE_ANG": 45, "RTL_LOITER_RAD": 80.0, "FLW_TGT_HT": 8.0, "FLW_TGT_DST": 8.0, "FLW_TGT_FA": 180.0,
    "FLW_TGT_RS": 0.1, "FLW_TGT_ALT_M": 0, "FLW_TGT_MAX_VEL": 5.0, "MC_ORBIT_RAD_MAX": 1000.0, "MC_ORBIT_YAW_MOD": 0,
    "PLD_BTOUT": 5.0, "PLD_MAX_SRCH": 3, "TRIG_MODE": 0, "MNT_MODE_IN": -1, "SDLOG_MODE": 0, "SDLOG_PROFILE": 1,
    "SDLOG_DIRS_MAX": 0,
    # multicopter control
    "MPC_XY_CRUISE": 5.0, "MPC_XY_VEL_MAX": 12.0, "MPC_XY_VEL_ALL": -10.0, "MPC_Z_VEL_MAX_UP": 3.0,
    "MPC_Z_VEL_MAX_DN": 1.5, "MPC_Z_V_AUTO_UP": 3.0, "MPC_Z_V_AUTO_DN": 1.5, "MPC_Z_VEL_ALL": -3.0,
    "MPC_VEL_MANUAL": 10.0, "MPC_VEL_MAN_BACK": -1.0, "MPC_VEL_MAN_SIDE": -1.0, "MPC_MAN_TILT_MAX": 35.0,
    "MPC_MAN_Y_MAX": 150.0, "MPC_MAN_Y_TAU": 0.08, "MPC_MANTHR_MIN": 0.08, "MPC_LAND_SPEED": 0.7,
    "MPC_LAND_CRWL": 0.3, "MPC_LAND_ALT1": 10.0, "MPC_LAND_ALT2": 5.0, "MPC_LAND_ALT3": 1.0, "MPC_LAND_RC_HELP": 0,
    "MPC_TKO_SPEED": 1.5, "MPC_TKO_RAMP_T": 3.0, "MPC_THR_HOVER": 0.5, "MPC_THR_MIN": 0.12, "MPC_THR_MAX": 1.0,
    "MPC_THR_CURVE": 0, "MPC_USE_HTE": 1, "MPC_TILTMAX_AIR": 45.0, "MPC_TILTMAX_LND": 12.0, "MPC_POS_MODE": 4,
    "MPC_ALT_MODE": 0, "MPC_YAW_MODE": 0, "MPC_HOLD_DZ": 0.1, "MPC_HOLD_MAX_XY": 0.8, "MPC_HOLD_MAX_Z": 0.6,
    "MPC_XY_MAN_EXPO": 0.6, "MPC_Z_MAN_EXPO": 0.6, "MPC_YAW_EXPO": 0.6, "MC_ACRO_R_MAX": 100.0,
    "MC_ACRO_P_MAX": 100.0, "MC_ACRO_Y_MAX": 100.0, "MC_ACRO_EXPO": 0.0, "MC_ACRO_EXPO_Y": 0.0,
    "MC_ACRO_SUPEXPO": 0.0, "MC_ACRO_SUPEXPOY": 0.0,
    "MC_AIRMODE": 0, "MPC_ACC_HOR": 3.0, "MPC_ACC_HOR_MAX": 5.0, "MPC_ACC_UP_MAX": 4.0, "MPC_ACC_DOWN_MAX": 3.0,
    "MPC_JERK_AUTO": 4.0, "MPC_JERK_MAX": 8.0, "MPC_XY_P": 0.95, "MPC_Z_P": 1.0, "MPC_XY_VEL_P_ACC": 1.8,
    "MPC_XY_VEL_I_ACC": 0.4, "MPC_XY_VEL_D_ACC": 0.2, "MPC_Z_VEL_P_ACC": 4.0, "MPC_Z_VEL_I_ACC": 2.0,
    "MPC_Z_VEL_D_ACC": 0.0, "MPC_YAWRAUTO_MAX": 60.0, "MPC_YAWRAUTO_ACC": 20.0, "MPC_XY_TRAJ_P": 0.5,
    "MPC_XY_ERR_MAX": 2.0, "LNDMC_Z_VEL_MAX": 0.25, "LNDMC_XY_VEL_MAX": 1.5, "LNDMC_ROT_MAX": 20.0,
    "LNDMC_TRIG_TIME": 1.0, "LNDMC_ALT_MAX": -1.0, "LNDMC_ALT_GND": 2.0, "LND_FLIGHT_T_HI": 0, "LND_FLIGHT_T_LO": 0,
    # estimator: the parameters that clients read
    "EKF2_EN": 1, "EKF2_GPS_CTRL": 7, "EKF2_BARO_CTRL": 1, "EKF2_MAG_TYPE": 0, "EKF2_HGT_REF": 1,
    "EKF2_NOAID_TOUT": 5000000, "EKF2_AID_MASK": 1,
    # simulator
    "SIM_BAT_DRAIN": 60.0, "SIM_BAT_ENABLE": 1, "SIM_BAT_MIN_PCT": 50.0, "SIM_GPS_USED": 10,
    # radio control: the parameters that clients read
    "RC_CHAN_CNT": 0, "RC_MAP_ROLL": 0, "RC_MAP_PITCH": 0, "RC_MAP_YAW": 0, "RC_MAP_THROTTLE": 0,
}  # fmt: skip


FLOAT32_MAX = 2.0**128 - 2.0**104


def _float32(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


class ParameterTable:
    """The present values by name. The names are sorted, so an index always means the same name.

    `core_defaults` are the parameters of the compiled core. `set_core` gets every later change of these parameters; the
    table stores the value that `set_core` returns, if any. Values other than the defaults are saved in `file` (JSON),
    if given. `unsaved` is the reason why the last save failed, or None. Raises UsageError if the file cannot be read or
    has a value that its parameter cannot hold.
    """

    def __init__(
        self,
        core_defaults: Mapping[str, float] | None = None,
        set_core: Callable[[str, float], float | None] | None = None,
        file: Path | None = None,
    ) -> None:
        core_defaults = core_defaults or {}
        self._defaults: dict[str, int | float] = {
            name: _coerced(value, isinstance(DEFAULTS.get(name), int))
            for name, value in sorted({**DEFAULTS, **core_defaults}.items())
        }
        self._values = dict(self._defaults)
        self._core_names = frozenset(core_defaults)
        self._set_core = set_core
        self._file: Path | None = None  # None while `file` is read, because a save would lose the values not yet read
        self.unsaved: str | None = None
        self.names = tuple(self._values)
        self._index = {name: i for i, name in enumerate(self.names)}
        if file is not None and file.exists():
            self._load(file)
        self._file = file

    def __getitem__(self, name: str) -> int | float:
        return self._values[name]

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Return the index of a parameter in `names`. Raises KeyError for an unknown name."""
        return self._index[name]

    def is_integer(self, name: str) -> bool:
        """Return whether the parameter is an INT32 (else REAL32). Raises KeyError for an unknown name."""
        return isinstance(self._defaults[name], int)

    def set(self, name: str, value: float) -> None:
        """Set a value. Raises KeyError for an unknown name, ValueError for a value that the type cannot hold."""
        coerced = _coerced(value, self.is_integer(name))
        if self._values[name] == coerced:
            return
        if self._set_core is not None and name in self._core_names:
            held = self._set_core(name, float(coerced))
            if held is not None:
                coerced = _coerced(held, self.is_integer(name))
        self._values[name] = coerced
        if self._file is not None:
            self._save(self._file)

    def reset(self) -> None:
        """Set every parameter to its default."""
        for name, value in self._defaults.items():
            self.set(name, value)

    def _load(self, file: Path) -> None:
        where = f"The parameter file {file}"
        try:
            changes = typed(json_of(file_bytes(file, where), where), dict[str, float], where)
        except UsageError as error:
            raise UsageError(f"{error}. Correct the file or delete it.") from error
        for name, value in changes.items():
            if name not in self._values:  # a name of an older version is ignored
                continue
            try:
                self.set(name, value)
            except ValueError as error:
                raise UsageError(f"{name} in the parameter file {file}: {error}. Correct it or delete it.") from error

    def _save(self, file: Path) -> None:
        changed = {name: value for name, value in self._values.items() if value != self._defaults[name]}
        try:
            write_text(file, json.dumps(changed, indent=1) + "\n")
            self.unsaved = None
        except OSError as error:  # a full disk must not stop the flight
            self.unsaved = error.strerror or "the disk reported an error"


def _coerced(value: float, integer: bool) -> int | float:
    """Convert a value to the type of its parameter. Raises ValueError if this is impossible."""
    if not math.isfinite(value):
        raise ValueError("a parameter must be finite")
    if not integer:
        if abs(value) > FLOAT32_MAX:
            raise ValueError("the value does not fit a 32-bit float")
        return _float32(value)
    if not -(1 << 31) <= value < 1 << 31:
        raise ValueError("the value does not fit a 32-bit integer")
    return int(value)
