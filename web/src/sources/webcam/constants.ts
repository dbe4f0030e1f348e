// Written by scripts/make_protocol_types.py from bodysense.devices.video.posture_constants. Do not edit.

/** probability from which a landmark counts as seen */
export const VISIBLE = 0.5;

// Cues of sitting, each 0 in the middle between people who sit and who stand, 1 in their usual spread.
/** degrees by which landmarks raise the thighs toward the front */
export const PITCH = [0, 20] as const;
/** distance of the knees in the picture by that of the hips: nearer knees are farther apart */
export const APART = [1.1, 0.15] as const;
/** length of the thighs in the picture by that of the shins */
export const SHORT = [1, -0.2] as const;
/** least and largest value of a cue */
export const CUE_RANGE = [-1, 2.5] as const;
/** sum of cues above which a person sits; rendered people have -1.7 to -0.2 on foot, 1.1 to 6 on seats */
export const SEATED = 0.3;
/** of the sum by which it must pass `SEATED` for a change */
export const MARGIN = 0.2;
/** s, of the averaging of cues */
export const CUE_HALF_LIFE = 0.4;
/** s, largest weight of a frame in it */
export const LONGEST_CUE = 0.5;
/** probability from which knees are cues; 0.4 at the edge of the picture, to 0.3 behind a table */
export const KNEE_VISIBLE = 0.35;
/** lower edge of the picture; legs beyond it are guessed as hanging, at a table with probabilities to 0.6 */
export const LOWEST = -0.5;
/** probability from which ankles count */
export const ANKLE_VISIBLE = 0.5;
/** probability from which ankles tell where the floor is, as do the knees of people who stand */
export const FEET_VISIBLE = 0.75;

// Legs of people who sit.
/** probability that is given to legs that are hidden */
export const ASSUMED = 0.5;
/** m, height of an unseen seat: completed bodies are within 8 cm on chairs (0.45) and on stools of 0.6 */
export const SEAT = 0.49;
/** m, of hip joints over the seat */
export const HIP_OVER_SEAT = 0.095;
/** m, of seats people sit on at desks */
export const SEAT_DEVIATION = 0.06;
/** m, of heights of knees under hips in the picture, on rendered people */
export const DROP_DEVIATION = 0.045;
/** m by which these are too large there: hips of raised thighs are seen 3 cm high, knees 3.5 cm low */
export const DROP_BIAS = 0.09;
/** m from the likely height beyond which a seen height counts alone */
export const USUAL = 0.15;
/** weight of knees that are seen higher than seats allow: they are guesses on a table's edge */
export const ON_TABLE = 0.1;
/** m, range of heights of the knees under the hips */
export const DROPS = [-0.35, 0.36] as const;
/** sine of the largest angle of a thigh to the front */
export const WIDEST = 0.6;

// Legs of people who stand.
/** of the pelvis's standing height, above which hidden legs stand */
export const STANDING = 0.85;
/** degrees of bend that straight knees of landmarks have */
export const STRAIGHT_BEND = 28;
/** degrees of bend above which bends are right */
export const TRUE_BEND = 75;

// Level of the camera.
/** degrees, largest angle between the bones of a standing body and the line from feet to shoulders */
export const UPRIGHT = 25;
/** degrees of tilt above which the body leans, not the camera */
export const STEEPEST = 35;
/** degrees of roll above which the body leans, not the camera */
export const MOST_ROLLED = 50;
/** s, time over which angles are averaged */
export const LONGEST_MEAN = 10;
/** s, largest weight of a frame in it */
export const LONGEST_ANGLE = 0.1;
/** degrees, usual lean of standing people; a camera with less roll is probably level */
export const SWAY = 3;
/** of the tilt of a trunk that the camera has: trunks of sitting people lean as much as cameras do */
export const TRUNK_SHARE = 0.5;
/** s of standing that count as much as the trunk */
export const ENOUGH = 1;

// Place of the body.
/** m, least distance of a person from the camera */
export const NEAR = 0.3;
/** factor of the error if the legs are not seen, because they are then assumed */
export const UNSEEN_LEGS = 3;
/** s, of the averaging of the floor's height */
export const FLOOR_HALF_LIFE = 1;
