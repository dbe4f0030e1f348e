/* The trunk: see trunk.h. */
#include "trunk.h"

#include "../base/kinematics.h"
#include "../constants.h"

void place(body *b, const tracked *t, vec3 head) {
    for (int j = BODY_JOINTS; j < BS_JOINTS; j++)
        b->rotation[j] = b->rotation[j < RIGHT_INDEX1 ? LEFT_WRIST : RIGHT_WRIST];
    place_points(b, t->rest_offset, HEAD, head, BS_POINTS);
}

vec3 placement(const body *b, const tracked *t, const prediction *p) {
    if (t->has_position[HEAD]) return sub(t->position[HEAD], b->point[HEAD]);
    if (t->has_position[PELVIS]) return sub(t->position[PELVIS], b->point[PELVIS]);
    vec3 off = vec(0, 0, 0);
    float count = 0.0F;
    for (int q = 0; q < BS_POINTS; q++) {
        if (!t->has_position[q]) continue;
        off = add(off, sub(t->position[q], b->point[q]));
        count += 1.0F;
    }
    return count > 0.0F ? scale(off, 1.0F / count) : sub(t->position[HEAD], p->head);
}

vec3 onto_floor(const body *b, const tracked *t) {
    float lowest = b->point[HEAD].y;
    for (int q = 0; q < BS_POINTS; q++) lowest = fminf(lowest, b->point[q].y);
    vec3 off = sub(t->position[HEAD], b->point[HEAD]);
    return vec(off.x, t->floor - lowest, off.z);
}

vec3 pelvis_off(const body *b, const tracked *t) {
    if (t->has_position[PELVIS]) return sub(t->position[PELVIS], b->point[PELVIS]);
    vec3 off = vec(0, 0, 0);
    float count = 0.0F;
    for (int q = LEFT_HIP; q <= RIGHT_HIP; q++) {
        if (!t->has_position[q]) continue;
        off = add(off, sub(t->position[q], b->point[q]));
        count += 1.0F;
    }
    return count > 0.0F ? scale(off, 1.0F / count) : off;
}

bool pelvis_seen(const tracked *t) {
    return t->has_position[PELVIS] || t->has_position[LEFT_HIP] || t->has_position[RIGHT_HIP];
}

void turn_neck(body *b, const tracked *t) {
    if (!t->has_position[HEAD] || !t->has_position[SPINE3] || known_rotation(t, NECK)) return;
    vec3 neck = add(t->position[SPINE3], rotate(b->rotation[SPINE3], t->rest_offset[NECK]));
    vec3 before = sub(b->point[HEAD], b->point[NECK]);
    b->rotation[NECK] = turned_onto(b->rotation[NECK], before, sub(b->point[HEAD], neck));
    place(b, t, b->point[HEAD]);
}

void bend_spine(body *b, const tracked *t, vec3 move) {
    if (dot(move, move) < SPINE_LEAST_MOVE * SPINE_LEAST_MOVE) return;
    bool chest = t->has_position[SPINE3] || known_rotation(t, SPINE3);
    vec3 top = b->point[chest ? SPINE3 : NECK];
    vec3 upper = sub(b->point[SPINE2], top), lower = sub(b->point[SPINE1], b->point[SPINE2]);
    /* A spine that is straight bends backward. */
    vec3 side = along(upper, b->rotation[SPINE3].z, -SPINE_BACK * length(upper));
    two_bones to = reach(add(sub(b->point[SPINE1], top), move), length(upper), length(lower), side);
    if (!chest) b->rotation[SPINE3] = turned_onto(b->rotation[SPINE3], upper, to.middle);
    b->rotation[SPINE2] = turned_onto(b->rotation[SPINE2], upper, to.middle);
    b->rotation[SPINE1] = turned_onto(b->rotation[SPINE1], lower, sub(to.end, to.middle));
    place(b, t, b->point[HEAD]);
}
