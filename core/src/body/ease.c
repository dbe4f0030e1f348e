/* Easing: see ease.h. */
#include "ease.h"

#include "../base/kinematics.h"
#include "../constants.h"

vec3 limited(vec3 v, float most) {
    float size = length(v);
    return size > most ? scale(v, most / size) : v;
}

ease ease_begin(vec3 offset, float span) { return (ease){.from = offset, .span = span}; }

/* The share of an offset that is gone after the share `u` of the span. */
static float gone(float u) {
    if (u < EASE_RAMP) return EASE_FASTER * u * u / (2.0F * EASE_RAMP);
    if (u > 1.0F - EASE_RAMP) return 1.0F - EASE_FASTER * (1.0F - u) * (1.0F - u) / (2.0F * EASE_RAMP);
    return EASE_FASTER * (u - 0.5F * EASE_RAMP);
}

bool easing(const ease *e) { return e->age < e->span; }

vec3 ease_offset(const ease *e) {
    if (!easing(e)) return vec(0, 0, 0);
    float u = e->age / e->span;
    return along(scale(e->from, 1.0F - gone(u)), e->slope, e->span * u * (1.0F - u) * (1.0F - u));
}

void ease_advance(ease *e, float interval) {
    if (easing(e)) e->age += interval;
}

vec3 eased(ease *e, vec3 goal, vec3 output_before, vec3 speed, float interval, bool breaks, float span, float steepest) {
    if (breaks) {
        vec3 offset = sub(along(output_before, limited(speed, EASE_FASTEST), interval), goal);
        *e = ease_begin(offset, span > interval ? fmaxf(span, EASE_FASTER * length(offset) / EASE_FASTEST) : 0.0F);
        e->speed = speed;
        e->goal = goal;
    } else {
        if (e->age == 0.0F) e->slope = limited(sub(e->speed, scale(sub(goal, e->goal), 1.0F / interval)), steepest);
        ease_advance(e, interval);
    }
    return add(goal, ease_offset(e));
}

mat3 eased_turn(ease *e, mat3 goal, mat3 output_before, vec3 spin, float interval, bool breaks, float span) {
    if (breaks) {
        *e = ease_begin(turn_between(goal, turned_by(output_before, scale(spin, interval))), span > interval ? span : 0.0F);
    } else {
        ease_advance(e, interval);
    }
    return turned_by(goal, ease_offset(e));
}
