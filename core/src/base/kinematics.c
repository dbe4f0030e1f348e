/* Placing bones, turning them onto directions, and two bones that reach a place. */
#include "kinematics.h"
#include "maths.h"
#include "../constants.h"

/* Some unit vector across a unit vector. */
static vec3 any_across(vec3 u) {
    vec3 other = fabsf(u.x) < 0.6F ? vec(1, 0, 0) : vec(0, 1, 0);
    return unit(across(other, u));
}

mat3 turned_onto(mat3 rotation, vec3 before, vec3 after) {
    vec3 u = unit(before), w = unit(after);
    if (dot(u, u) < 0.5F || dot(w, w) < 0.5F) return rotation;
    float cosine = dot(u, w);
    if (cosine < -0.9999F) return turned_by(rotation, scale(any_across(u), 3.14159265F));
    vec3 k = cross(u, w);
    float f = 1.0F / (1.0F + cosine);
    vec3 *column[3] = {&rotation.x, &rotation.y, &rotation.z};
    for (int i = 0; i < 3; i++) {
        vec3 once = cross(k, *column[i]);
        *column[i] = along(add(*column[i], once), cross(k, once), f);
    }
    return rotation;
}

vec3 turn_between(mat3 from, mat3 to) {
    mat3 m = product(to, transpose(from));
    vec3 twice = vec(m.y.z - m.z.y, m.z.x - m.x.z, m.x.y - m.y.x); /* 2 sin(angle) axis */
    float sine = 0.5F * length(twice), cosine = 0.5F * (m.x.x + m.y.y + m.z.z - 1.0F);
    float angle = angle_of(sine, cosine);
    if (sine > 1e-4F) return scale(twice, angle / (2.0F * sine));
    if (cosine > 0.0F) return scale(twice, 0.5F);
    /* Half a turn: its axis is the largest column of m + 1. */
    vec3 a = add(m.x, vec(1, 0, 0)), b = add(m.y, vec(0, 1, 0)), c = add(m.z, vec(0, 0, 1));
    vec3 largest = dot(a, a) > dot(b, b) ? a : b;
    if (dot(c, c) > dot(largest, largest)) largest = c;
    return scale(unit(largest), angle);
}

mat3 turned_by(mat3 rotation, vec3 turn) {
    float angle = length(turn);
    if (angle < 1e-7F) return rotation;
    vec3 k = scale(turn, 1.0F / angle);
    float sine, cosine;
    sine_cosine(angle, &sine, &cosine);
    const float rest = 1.0F - cosine;
    vec3 *column[3] = {&rotation.x, &rotation.y, &rotation.z};
    for (int i = 0; i < 3; i++) {
        vec3 once = cross(k, *column[i]);
        *column[i] = along(along(*column[i], once, sine), cross(k, once), rest);
    }
    return rotation;
}

void heading_of(mat3 rotation, float *cosine, float *sine) {
    float c = rotation.x.x + rotation.z.z, s = rotation.z.x - rotation.x.z;
    float size = sqrtf(c * c + s * s);
    *cosine = size > 1e-6F ? c / size : 1.0F;
    *sine = size > 1e-6F ? s / size : 0.0F;
}

void place_points(body *b, const vec3 *rest_offset, int anchor, vec3 place, int points) {
    /* From the anchor up to the root, then down to all others. */
    vec3 root = place;
    for (int p = anchor; PARENT[p] >= 0; p = PARENT[p]) root = sub(root, rotate(b->rotation[PARENT[p]], rest_offset[p]));
    b->point[0] = root;
    for (int p = 1; p < points; p++)
        b->point[p] = add(b->point[PARENT[p]], rotate(b->rotation[PARENT[p]], rest_offset[p]));
}

two_bones reach(vec3 end, float upper, float lower, vec3 side) {
    float far = length(end), longest = LIMB_STRAIGHT * (upper + lower), shortest = fabsf(upper - lower);
    vec3 direction = far > 1e-6F ? scale(end, 1.0F / far) : vec(0, -1, 0);
    float distance_to = fminf(fmaxf(far, shortest + 1e-5F), longest);
    float forward = 0.5F * (distance_to + (upper * upper - lower * lower) / distance_to);
    float aside = sqrtf(fmaxf(upper * upper - forward * forward, 0.0F));
    vec3 pole = across(side, direction);
    pole = dot(pole, pole) > 1e-12F ? unit(pole) : any_across(direction);
    two_bones result = {along(scale(direction, forward), pole, aside), scale(direction, distance_to)};
    return result;
}

float standing_height(const tracked *t, int point) {
    float height = 0.0F;
    for (int p = point; p >= 0; p = PARENT[p]) height += t->rest_offset[p].y;
    return height;
}
