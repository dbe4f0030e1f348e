/* Easing: see ease.h. */
#include "ease.h"

ease ease_begin(vec3 offset, float span) {
    ease e = {offset, 0.0F, span};
    return e;
}

vec3 ease_offset(const ease *e) {
    if (!(e->age < e->span)) return vec(0, 0, 0);
    float u = e->age / e->span;
    return scale(e->from, 1.0F + u * u * (2.0F * u - 3.0F));
}

void ease_advance(ease *e, float interval) {
    if (e->age < e->span) e->age += interval;
}

float ease_span(float offset, float fastest) { return 1.5F * offset / fastest; }
