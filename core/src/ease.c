/* Easing: see ease.h. */
#include "ease.h"

#include "kinematics.h"

static const float CUBIC = 1.5F; /* the fastest of a cubic beside its mean speed */

vec3 limited(vec3 v, float most) {
    float size = length(v);
    return size > most ? scale(v, most / size) : v;
}

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

vec3 eased(ease *e, vec3 goal, vec3 output_before, vec3 speed, float interval, bool breaks, float span) {
    if (breaks) {
        vec3 offset = sub(along(output_before, limited(speed, FASTEST), interval), goal);
        *e = ease_begin(offset, span > 0.0F ? fmaxf(span, CUBIC * length(offset) / FASTEST) : 0.0F);
    } else {
        ease_advance(e, interval);
    }
    return add(goal, ease_offset(e));
}

mat3 eased_turn(ease *e, mat3 goal, mat3 output_before, vec3 spin, float interval, bool breaks, float span) {
    if (breaks) {
        *e = ease_begin(turn_between(goal, turned_by(output_before, scale(spin, interval))), span);
    } else {
        ease_advance(e, interval);
    }
    return turned_by(goal, ease_offset(e));
}
