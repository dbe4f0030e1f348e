/* Arms and legs: two bones each that come to where their joints are measured or predicted. */
#ifndef BODYSENSE_LIMBS_H
#define BODYSENSE_LIMBS_H

#include "../base/kinematics.h"
#include "../body/pose_state.h"

/* The joints of a limb, from the one that carries it. */
typedef struct limb_joints {
    signed char carrier, start, middle, end;
    signed char stand_in[5]; /* points that tell where the end is if it is not measured itself; -1: none */
} limb_joints;

extern const limb_joints LIMB[LIMBS];

static inline bool is_leg(int limb) { return limb >= LEFT_LEG; }

/* A limb's task in a frame. Vectors are in the world, from the limb's start, m. */
typedef struct limb_task {
    vec3 end, middle;            /* where they should be */
    bool end_seen, middle_seen;  /* measured */
    bool start_turned, middle_turned; /* rotation of the upper, of the lower bone is measured */
    vec3 upper, lower;           /* bones as their rotations carry them */
    vec3 ahead;                  /* the shin's front, which a thigh is never behind; zero for arms */
} limb_task;

/* Find which limbs have points that stand in for their ends.
 *
 * A finger does once it has been seen for `ease` seconds: a body that follows one that blinks jumps. */
void find_stand_ins(const bs_settings *settings, pose_state *s, tracked *t);

/* Return the goal of a limb before easing, from measured points, rotations and the prediction.
 *
 * `rotation`: goals of the body's joints. `b`: the body so far, with the output rotations of hands, feet and measured
 * bones. `start`: position of the limb's start, from base. */
limb_task limb_goal(const tracked *t, int limb, const mat3 rotation[BODY_JOINTS], const body *b, vec3 start);

/* Keep a knee that is on its way to where it is measured from bending backward, seen from the thigh's rotation. */
void keep_forward(limb_task *task, const tracked *t, int limb, mat3 thigh);

/* Middle and end from the start, as far as bones reach. */
two_bones solve_limb(const limb_task *task);

/* Learn about which axis elbows bend from the predicted rotations of an arm, world ← joint. */
void learn_hinge(const tracked *t, int limb, const mat3 rotation[BODY_JOINTS], hinge_state *hinge);

/* Turn an arm about its upper bone so that its elbow bends about the learned axis only. Places stay. */
void hinge_elbow(body *b, const tracked *t, int limb, const hinge_state *hinge);

/* Turn the bones of a limb as solved. */
void turn_limb(body *b, const tracked *t, int limb, two_bones to);

#endif
