/* Feet that stand: held in place along the floor, on the floor, and put elsewhere by steps. */
#ifndef BODYSENSE_FEET_H
#define BODYSENSE_FEET_H

#include "../body/pose_state.h"

/* One foot as it would be without the floor. */
typedef struct foot {
    vec3 ankle, ball, toe;          /* m, from base */
    float ankle_rest, ball_rest;    /* m, heights over the floor in the rest pose */
    float ankle_contact, ball_contact; /* probability */
    bool seen;                      /* a point of the foot is measured: it is where it is */
    bool met;                       /* the ankle is where it is measured */
    float away;                     /* m, from an ankle that is measured to where it is measured */
    bool turned;                    /* its rotation is measured */
    bool driven;                    /* a bone of the leg or the knee is measured, or eased to or from there */
    float kneels;                   /* 1 if the knee is on the floor and the shin with it, 0 if the foot may stand */
} foot;

/* How a foot is moved so that it stands. */
typedef struct foot_move {
    vec3 shift;  /* m */
    float turn;  /* rad about +Y, about the ankle */
} foot_move;

/* How far to move each foot so that it stands still, on the floor and not under it, or steps where it belongs.
 *
 * `carrier` is where the body is. `upright` is 1 if the body stands (then one foot at least is on the floor), 0 if it
 * sits, lies or jumps. */
void hold_feet(const foot foot[2], carrier body, float floor, float interval, float upright, foot_state state[2],
               foot_move move[2]);

/* How flat a foot that stands is on the floor, 0 to 1. */
float flatness(const foot_state *s);

#endif
