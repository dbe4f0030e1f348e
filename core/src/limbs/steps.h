/* Steps: a foot that stands and truly belongs elsewhere is lifted and put there, one foot at a time.
 *
 * The network predicts a mean of both feet while people shuffle or turn on the spot: feet on the floor that glide. A foot
 * that stands is held, and strains the farther it is from where it is predicted. Predictions of people who stand still
 * sway by 8 cm, so only what the body's own motion confirms counts: if the head and the pelvis had carried the foot
 * along since it was put down, it would be there. */
#ifndef BODYSENSE_STEPS_H
#define BODYSENSE_STEPS_H

#include "../body/pose_state.h"

/* Note where the body is when a foot is put down at `anchor`. */
void put_down(foot_state *s, carrier body, vec3 anchor);

/* Strain a foot that stands for a frame: `contact` is the probability that it does, `dragged` how far (m) the leg drags it
 * along the floor in this frame. */
void strain_foot(foot_state *s, carrier body, float contact, float interval, float dragged);

/* Begin the step of the foot that strains more, if it strains enough and the other one stands. */
void begin_step(foot_state state[2]);

static inline bool steps(const foot_state *s) { return s->step.span > 0.0F; }

/* A step in one frame. */
typedef struct foot_flight {
    float lift; /* m, height over the floor */
    bool moves; /* `slide` and `turn` follow the step; else the foot rises or lands, and stays where it is */
} foot_flight;

/* Advance a step by a frame. */
foot_flight advance_step(foot_state *s, float interval);

/* How high (m) a foot is lifted because its ball, which comes to `ball`, moves along the floor. `driven`: measured bones move
 * it, and it is not lifted. */
float lift_moving(foot_state *s, vec3 ball, bool driven, float interval);

#endif
