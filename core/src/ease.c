/* Easing: see ease.h. */
#include "ease.h"

ease ease_over(void) {
    ease e = {{0, 0, 0}, {0, 0, 0}, 0.0F, 0.0F};
    return e;
}

vec3 ease_offset(const ease *e) {
    if (!(e->age < e->span)) return vec(0, 0, 0);
    float u = e->age / e->span, cube = u * u * u;
    float of_place = 1.0F + cube * (-10.0F + u * (15.0F - 6.0F * u));
    float of_speed = e->age + e->span * cube * (-6.0F + u * (8.0F - 3.0F * u));
    return along(scale(e->from, of_place), e->speed, of_speed);
}

ease ease_begin(vec3 offset, vec3 speed, float span) {
    ease e = {offset, speed, 0.0F, span};
    return e;
}

void ease_advance(ease *e, float interval) {
    if (e->age < e->span) e->age += interval;
}
