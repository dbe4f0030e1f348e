/* The skeleton: names, parents and partners of points. Joints come first, parents before their children. */
#ifndef BODYSENSE_SKELETON_H
#define BODYSENSE_SKELETON_H

#define BODY_JOINTS 22   /* the joints of the body, without the hands */
#define BODY_POINTS 25 /* the joints of the body, head top and both toe tips */
#define KNUCKLES 4       /* of a hand, between palm and fingers; the thumb has none */
#define HAND_JOINTS 15   /* of one hand */
#define HAND_POINTS 20   /* of one hand: its joints, then its finger tips */

enum point {
    PELVIS, LEFT_HIP, RIGHT_HIP, SPINE1, LEFT_KNEE, RIGHT_KNEE, SPINE2, LEFT_ANKLE, RIGHT_ANKLE, SPINE3, LEFT_FOOT,
    RIGHT_FOOT, NECK, LEFT_COLLAR, RIGHT_COLLAR, HEAD, LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_ELBOW, RIGHT_ELBOW,
    LEFT_WRIST, RIGHT_WRIST, LEFT_INDEX1, LEFT_INDEX2, LEFT_INDEX3, LEFT_MIDDLE1, LEFT_MIDDLE2, LEFT_MIDDLE3,
    LEFT_PINKY1, LEFT_PINKY2, LEFT_PINKY3, LEFT_RING1, LEFT_RING2, LEFT_RING3, LEFT_THUMB1, LEFT_THUMB2, LEFT_THUMB3,
    RIGHT_INDEX1, RIGHT_INDEX2, RIGHT_INDEX3, RIGHT_MIDDLE1, RIGHT_MIDDLE2, RIGHT_MIDDLE3, RIGHT_PINKY1,
    RIGHT_PINKY2, RIGHT_PINKY3, RIGHT_RING1, RIGHT_RING2, RIGHT_RING3, RIGHT_THUMB1, RIGHT_THUMB2, RIGHT_THUMB3,
    HEAD_TOP, LEFT_TOE, RIGHT_TOE, LEFT_INDEX_TIP, RIGHT_INDEX_TIP, LEFT_MIDDLE_TIP, RIGHT_MIDDLE_TIP,
    LEFT_PINKY_TIP, RIGHT_PINKY_TIP, LEFT_RING_TIP, RIGHT_RING_TIP, LEFT_THUMB_TIP, RIGHT_THUMB_TIP
};

static const signed char PARENT[BS_POINTS] = {
    -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 22, 23, 20, 25, 26, 20, 28, 29, 20,
    31, 32, 20, 34, 35, 21, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 15, 10, 11, 24, 39, 27, 42, 30,
    45, 33, 48, 36, 51
};

/* The partner of each point on the other side; points of the middle are their own. */
static const signed char PARTNER[BS_POINTS] = {
    0, 2, 1, 3, 5, 4, 6, 8, 7, 9, 11, 10, 12, 14, 13, 15, 17, 16, 19, 18, 21, 20, 37, 38, 39, 40, 41, 42, 43, 44, 45,
    46, 47, 48, 49, 50, 51, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31, 32, 33, 34, 35, 36, 52, 54, 53, 56, 55, 58, 57,
    60, 59, 62, 61, 64, 63
};

/* Points whose position the network predicts, in its order. */
static const signed char BODY_POINT[BODY_POINTS] = {
    PELVIS, LEFT_HIP, RIGHT_HIP, SPINE1, LEFT_KNEE, RIGHT_KNEE, SPINE2, LEFT_ANKLE, RIGHT_ANKLE, SPINE3, LEFT_FOOT,
    RIGHT_FOOT, NECK, LEFT_COLLAR, RIGHT_COLLAR, HEAD, LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_ELBOW, RIGHT_ELBOW,
    LEFT_WRIST, RIGHT_WRIST, HEAD_TOP, LEFT_TOE, RIGHT_TOE
};

#endif
