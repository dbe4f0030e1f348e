/* Easing: an offset that starts where motion would jump and is exactly zero a set time later.
 *
 * What is output goes on, and its difference to the goal decays by a cubic polynomial that starts and ends at rest
 * (after Bollo, Inertialization, GDC 2018). The cubic is the slowest at its fastest: 1.5 times the mean speed.
 */
#ifndef BODYSENSE_EASE_H
#define BODYSENSE_EASE_H

#include "internal.h"

typedef struct ease {
    vec3 from;  /* offset at the start: m, or rad as a rotation vector */
    float age;  /* s since the start */
    float span; /* s after which it is zero */
} ease;

/* Start with an offset that is gone after `span` seconds; 0 is over at once. */
ease ease_begin(vec3 offset, float span);

/* The offset now. */
vec3 ease_offset(const ease *e);

void ease_advance(ease *e, float interval);

/* The span (s) over which an offset (m) decays at a speed (m/s) that is never exceeded. */
float ease_span(float offset, float fastest);

#endif
