"""Numbers by which the posture of a person before a camera and the camera's level are judged.

The page reads the same numbers: `web/src/sources/webcam/constants.ts` is written from this file by
scripts/make_protocol_types.py. Each was chosen on rendered people who sit and stand before two cameras.
"""

VISIBLE = 0.5  # probability from which a landmark counts as seen

# Cues of sitting, each 0 in the middle between people who sit and who stand, 1 in their usual spread.
PITCH = (0.0, 20.0)  # degrees by which landmarks raise the thighs toward the front
APART = (1.1, 0.15)  # distance of the knees in the picture by that of the hips: nearer knees are farther apart
SHORT = (1.0, -0.2)  # length of the thighs in the picture by that of the shins
CUE_RANGE = (-1.0, 2.5)  # least and largest value of a cue
SEATED = 0.3  # sum of cues above which a person sits; rendered people have -1.7 to -0.2 on foot, 1.1 to 6 on seats
MARGIN = 0.2  # of the sum by which it must pass `SEATED` for a change
CUE_HALF_LIFE = 0.4  # s, of the averaging of cues
LONGEST_CUE = 0.5  # s, largest weight of a frame in it
KNEE_VISIBLE = 0.35  # probability from which knees are cues; 0.4 at the edge of the picture, to 0.3 behind a table
LOWEST = -0.5  # lower edge of the picture; legs beyond it are guessed as hanging, at a table with probabilities to 0.6
ANKLE_VISIBLE = 0.5  # probability from which ankles count
FEET_VISIBLE = 0.75  # probability from which ankles tell where the floor is, as do the knees of people who stand

# Legs of people who sit.
ASSUMED = 0.5  # probability that is given to legs that are hidden
SEAT = 0.49  # m, height of an unseen seat: completed bodies are within 8 cm on chairs (0.45) and on stools of 0.6
HIP_OVER_SEAT = 0.095  # m, of hip joints over the seat
SEAT_DEVIATION = 0.06  # m, of seats people sit on at desks
DROP_DEVIATION = 0.045  # m, of heights of knees under hips in the picture, on rendered people
DROP_BIAS = 0.09  # m by which these are too large there: hips of raised thighs are seen 3 cm high, knees 3.5 cm low
USUAL = 0.15  # m from the likely height beyond which a seen height counts alone
ON_TABLE = 0.1  # weight of knees that are seen higher than seats allow: they are guesses on a table's edge
DROPS = (-0.35, 0.36)  # m, range of heights of the knees under the hips
WIDEST = 0.6  # sine of the largest angle of a thigh to the front

# Legs of people who stand.
STANDING = 0.85  # of the pelvis's standing height, above which hidden legs stand
STRAIGHT_BEND = 28.0  # degrees of bend that straight knees of landmarks have
TRUE_BEND = 75.0  # degrees of bend above which bends are right

# Level of the camera.
UPRIGHT = 25.0  # degrees, largest angle between the bones of a standing body and the line from feet to shoulders
STEEPEST = 35.0  # degrees of tilt above which the body leans, not the camera
MOST_ROLLED = 50.0  # degrees of roll above which the body leans, not the camera
LONGEST_MEAN = 10.0  # s, time over which angles are averaged
LONGEST_ANGLE = 0.1  # s, largest weight of a frame in it
SWAY = 3.0  # degrees, usual lean of standing people; a camera with less roll is probably level
TRUNK_SHARE = 0.5  # of the tilt of a trunk that the camera has: trunks of sitting people lean as much as cameras do
ENOUGH = 1.0  # s of standing that count as much as the trunk

# Place of the body.
NEAR = 0.3  # m, least distance of a person from the camera
UNSEEN_LEGS = 3.0  # factor of the error if the legs are not seen, because they are then assumed
FLOOR_HALF_LIFE = 1.0  # s, of the averaging of the floor's height
