/* Easing: an offset that starts where motion would jump and is exactly zero a set time later.
 *
 * What is output goes on, and its difference to the goal is taken away at a speed that rises, stays and falls: a quarter
 * faster at its fastest than on average, where a cubic polynomial is half as fast again (the idea: Bollo,
 * Inertialization, GDC 2018). Where the goal's own speed differs from the output's, the offset starts with that slope.
 */
#ifndef BODYSENSE_EASE_H
#define BODYSENSE_EASE_H

#include "internal.h"

typedef struct ease {
    vec3 from;        /* offset at the start: m, or rad as a rotation vector */
    float age;        /* s since the start */
    float span;       /* s after which it is zero */
    vec3 slope;       /* m/s: how fast the offset changes at first, beside its way to zero */
    vec3 speed, goal; /* m/s, m: of the output before, and the goal, at the start */
} ease;

/* A vector no longer than `most`. */
vec3 limited(vec3 v, float most);

/* Start with an offset that is gone after `span` seconds; 0 is over at once. */
ease ease_begin(vec3 offset, float span);

/* The offset now. */
vec3 ease_offset(const ease *e);

void ease_advance(ease *e, float interval);

/* Ease a vector (m) toward its goal and return what to output.
 *
 * If its motion breaks, what is output goes on with its speed (m/s) for a frame, and the difference to the goal decays
 * over `span` seconds from then on, or longer if it would move faster than FASTEST. The second frame shows how fast the
 * goal moves; the output's speed comes to that along the span, if they differ by no more than `steepest` (m/s). */
#define FASTEST 10.0F /* m/s */
vec3 eased(ease *e, vec3 goal, vec3 output_before, vec3 speed, float interval, bool breaks, float span, float steepest);

/* The same for a rotation, with its spin in rad/s. */
mat3 eased_turn(ease *e, mat3 goal, mat3 output_before, vec3 spin, float interval, bool breaks, float span);

#endif
