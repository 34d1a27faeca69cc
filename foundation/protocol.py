"""Numbers and words of the benchmark's protocol, which make flights comparable. Each cites the paper's section.

Numbers that the paper leaves open are in the package that decides them. The camera is `foundation.camera.CameraModel`.
"""

# One Success Criterion for the Whole Grid; appendix "Metrics"
CAP_S = 300.0  # s of vehicle time, the length of an episode
RADIUS_M = 5.0  # m, δ: success is declared within it of the target's centre, in three dimensions
POSE_PERIOD_S = 0.5  # s, of the pose trace: 2 Hz
DETECTION_RANGE_M = 300.0  # m; nothing farther counts as seen

# Action Space
GO, ROTATE, THINK, FINISHED = "go", "rotate", "think", "finished"  # as replies and logs name the actions
ACTIONS = (GO, ROTATE, THINK, FINISHED)  # a new one is added at the end: logs of PX4 number them
ACTION_FIELDS = ("action", "point", "depth_m", "angle_deg")  # of a reply's JSON object, the action's name first
POINT_SPAN = 1000.0  # of a point's two axes, whatever the picture's shape

# Execution; appendix "Execution"
HISTORY_LENGTH = 5  # actions that the prompt shows
STEP_S = 2.5  # s that a move is held
STRIDE_MAX_M = 3.0  # m, the longest move
SPEED_MAX = STRIDE_MAX_M / STEP_S  # m/s, 1.2
BEARING_DEADBAND_DEG = 8.0  # °, off the axis, beyond which the drone turns before it moves
CLIMB_DEADBAND = 0.15  # of the horizontal distance; a smaller vertical displacement is dropped
NEAR_M, NEAR_SCALE = 5.0, 0.6  # m of depth below which a stride is scaled, and to what
BRAKE_M = 2.0  # m of depth below which the drone brakes
STRIDE_MIN_M = NEAR_SCALE * BRAKE_M  # m, 1.2, the shortest move
YAW_RATE_DEG = 60.0  # °/s of a turn

# Ours, since the paper's simulator has no such rate: a PX4 in offboard mode wants more than 2 Hz
SETPOINT_HZ = 20  # Hz of vehicle time
