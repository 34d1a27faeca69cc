"""Constants of the benchmark's protocol, which make flights comparable. Comments cite the paper's sections.

Most numbers that the paper does not give are defined in the package that uses them. The camera's numbers are in
`foundation.camera.CameraModel`.
"""

# "One Success Criterion for the Whole Grid"; appendix "Metrics"
CAP_S = 300.0  # s of vehicle time, the length of an episode
RADIUS_M = 5.0  # m, δ: a successful declaration is within this 3-D distance of the target's centre
POSE_PERIOD_S = 0.5  # s between two logged poses: 2 Hz
DETECTION_RANGE_M = 300.0  # m; objects farther away do not count as seen

# "Action Space"
GO, ROTATE, THINK, FINISHED = "go", "rotate", "think", "finished"  # names of the actions in replies and logs
ACTIONS = (GO, ROTATE, THINK, FINISHED)  # add new ones at the end: logs of PX4 store their index
ACTION_FIELDS = ("action", "point", "depth_m", "angle_deg")  # keys of a reply's JSON object; the action's name is first
POINT_SPAN = 1000.0  # a point's x and y are 0 … 1000 across a picture of any size

# "Execution"; appendix "Execution"
HISTORY_LENGTH = 5  # actions that the prompt shows
STEP_S = 2.5  # s, duration of a move
STRIDE_MAX_M = 3.0  # m, the longest move
SPEED_MAX = STRIDE_MAX_M / STEP_S  # m/s, 1.2
BEARING_DEADBAND_DEG = 8.0  # °, bearing beyond which the drone turns before it moves
CLIMB_DEADBAND = 0.15  # share of the horizontal distance; a smaller vertical displacement is dropped
NEAR_M, NEAR_SCALE = 5.0, 0.6  # m, factor: if the depth is below NEAR_M, the stride is multiplied by NEAR_SCALE
BRAKE_M = 2.0  # m; with a smaller depth, the drone stops instead of moving
STRIDE_MIN_M = NEAR_SCALE * BRAKE_M  # m, 1.2, the shortest move
YAW_RATE_DEG = 60.0  # °/s, rate of a turn

# not in the paper, whose simulator needs no stream of setpoints; PX4 in offboard mode needs more than 2 Hz
SETPOINT_HZ = 20  # setpoints per second of vehicle time
