/* Easing: an offset that starts where motion would jump and is exactly zero a set time later.
 *
 * Inertialization (Bollo, GDC 2018): what is output goes on with its velocity, and the difference to the goal decays by
 * a polynomial of fifth degree, so that position, velocity and acceleration meet the goal's at the end.
 */
#ifndef BODYSENSE_EASE_H
#define BODYSENSE_EASE_H

#include "internal.h"

typedef struct ease {
    vec3 from;  /* offset at the start: m, or rad as a rotation vector */
    vec3 speed; /* its rate at the start, per s */
    float age;  /* s since the start */
    float span; /* s after which it is zero */
} ease;

/* No offset. */
ease ease_over(void);

/* The offset now. */
vec3 ease_offset(const ease *e);

/* Start with an offset and its rate, to be gone after `span` seconds; 0 is over at once. */
ease ease_begin(vec3 offset, vec3 speed, float span);

void ease_advance(ease *e, float interval);

#endif
