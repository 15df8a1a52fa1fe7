"""Beyond what any such sensor says: larger numbers came to harm on their way."""

MAX_ALT_M, MAX_POS_STD_M = 1e5, 1e6  # limits of a receiver
MAX_SPEED_MPS, MAX_YAW_STD_RAD = 1e3, 1e3
MAX_FIELD_T = 1e3
MAX_READING = 1e9  # the sum of all numbers of an encoder's or an IMU's sample
# Least time between two encoder readings, s: what differs by less is one time, rounded.
LEAST_STEP_S = 1e-4
