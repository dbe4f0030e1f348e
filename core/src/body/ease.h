/* Easing: an offset that prevents a jump and is exactly zero after a given time.
 *
 * The output continues, and its difference to the goal is removed at a speed that rises, is constant and falls: its
 * maximum is 1.25 times its mean, and 1.5 times for a cubic polynomial (the idea: Bollo, Inertialization, GDC 2018).
 * If the goal's own speed differs from the output's, the offset starts with that slope.
 */
#ifndef BODYSENSE_EASE_H
#define BODYSENSE_EASE_H

#include "../base/internal.h"

typedef struct ease {
    vec3 from;        /* offset at the start: m, or rad as a rotation vector */
    float age;        /* s since the start */
    float span;       /* s after which it is zero */
    vec3 slope;       /* m/s: initial speed of the offset, added to that of its decay */
    vec3 speed, goal; /* m/s, m: of the output before, and the goal, at the start */
} ease;

/* A vector no longer than `most`. */
vec3 limited(vec3 v, float most);

/* Start with an offset that is gone after `span` seconds; 0 is over at once. */
ease ease_begin(vec3 offset, float span);

/* The offset now. */
vec3 ease_offset(const ease *e);

/* Whether the offset is not gone yet. */
bool easing(const ease *e);

void ease_advance(ease *e, float interval);

/* Ease a vector (m) toward its goal and return what to output.
 *
 * If its motion breaks, the output keeps its speed (m/s) for a frame, and the difference to the goal decays over `span`
 * seconds from then on, or longer if it would move faster than EASE_FASTEST; at once if `span` is shorter than a frame.
 * The second frame gives the goal's speed; the output's speed approaches it along the span, if they differ by no more
 * than `steepest` (m/s). */
vec3 eased(ease *e, vec3 goal, vec3 output_before, vec3 speed, float interval, bool breaks, float span, float steepest);

/* Ease a rotation as `eased` does a vector, with its spin in rad/s. */
mat3 eased_turn(ease *e, mat3 goal, mat3 output_before, vec3 spin, float interval, bool breaks, float span);

#endif
