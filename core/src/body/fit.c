/* Fitting: see fit.h. Position-based constraints (Müller et al., Position Based Dynamics, 2007): joints are moved one
 * constraint after the other, so that bones keep their lengths and measured joints are where they are measured. The
 * body then takes up a difference as a whole, and not the first joint of a chain alone.
 *
 *     predicted places → bones, trunk, measured joints, in turn → rotations that turn each bone as found
 */
#include "fit.h"

#include "../base/kinematics.h"
#include "../base/maths.h"
#include "../constants.h"
#include "trunk.h"

/* Share of a correction that each joint takes. */
static const float GIVES[BODY_JOINTS] = {
    [PELVIS] = GIVES_TRUNK, [LEFT_HIP] = GIVES_TRUNK, [RIGHT_HIP] = GIVES_TRUNK,
    [SPINE1] = GIVES_TRUNK, [SPINE2] = GIVES_TRUNK, [SPINE3] = GIVES_TRUNK,
    [NECK] = GIVES_TRUNK, [HEAD] = GIVES_HEAD, [LEFT_COLLAR] = GIVES_SHOULDER,
    [RIGHT_COLLAR] = GIVES_SHOULDER, [LEFT_SHOULDER] = GIVES_SHOULDER, [RIGHT_SHOULDER] = GIVES_SHOULDER,
    [LEFT_ELBOW] = GIVES_LIMB, [RIGHT_ELBOW] = GIVES_LIMB, [LEFT_WRIST] = GIVES_LIMB,
    [RIGHT_WRIST] = GIVES_LIMB, [LEFT_KNEE] = GIVES_LIMB, [RIGHT_KNEE] = GIVES_LIMB,
    [LEFT_ANKLE] = GIVES_LIMB, [RIGHT_ANKLE] = GIVES_LIMB, [LEFT_FOOT] = GIVES_LIMB,
    [RIGHT_FOOT] = GIVES_LIMB,
};

/* Distances that keep the shape of pelvis and chest, as predicted. */
static const signed char STIFF[][2] = {
    {LEFT_HIP, RIGHT_HIP}, {LEFT_HIP, SPINE1},  {RIGHT_HIP, SPINE1}, {LEFT_COLLAR, RIGHT_COLLAR},
    {LEFT_COLLAR, NECK},   {RIGHT_COLLAR, NECK}, {SPINE2, NECK},
};
enum { STIFF_COUNT = sizeof STIFF / sizeof *STIFF };

/* Joints that one bone turns, with its end. */
static const signed char BONES[][2] = {
    {SPINE1, SPINE2},
    {SPINE2, SPINE3},
    {NECK, HEAD},
    {LEFT_COLLAR, LEFT_SHOULDER},
    {RIGHT_COLLAR, RIGHT_SHOULDER},
    {LEFT_SHOULDER, LEFT_ELBOW},
    {RIGHT_SHOULDER, RIGHT_ELBOW},
    {LEFT_ELBOW, LEFT_WRIST},
    {RIGHT_ELBOW, RIGHT_WRIST},
    {LEFT_HIP, LEFT_KNEE},
    {RIGHT_HIP, RIGHT_KNEE},
    {LEFT_KNEE, LEFT_ANKLE},
    {RIGHT_KNEE, RIGHT_ANKLE},
};

/* Move two joints so that the second is where `off` is taken from it, relative to the first. */
static void correct(vec3 found[BODY_JOINTS], int first, int second, vec3 off) {
    float both = GIVES[first] + GIVES[second];
    found[first] = along(found[first], off, GIVES[first] / both);
    found[second] = along(found[second], off, -GIVES[second] / both);
}

static void keep_distance(vec3 found[BODY_JOINTS], int first, int second, float size) {
    vec3 apart = sub(found[second], found[first]);
    float now = length(apart);
    if (now > 1e-6F) correct(found, first, second, scale(apart, (now - size) / now));
}

/* Places (m) that measured joints and bones agree on, near those of a predicted body. */
static void find_places(const tracked *t, const body *b, vec3 found[BODY_JOINTS]) {
    float share[BODY_JOINTS], size[BODY_JOINTS], stiff[STIFF_COUNT];
    vec3 displacement[BODY_JOINTS];
    for (int j = 0; j < BODY_JOINTS; j++) {
        bool seen = t->has_position[j], spine = j == PELVIS || j == SPINE1 || j == SPINE2 || j == SPINE3;
        float doubt = FIT_DOUBT * t->accuracy[j];
        share[j] = seen ? 1.0F / (1.0F + doubt * doubt) : 0.0F;
        size[j] = length(t->rest_offset[j]);
        /* Joints beyond a measured one start with its displacement. */
        vec3 carried = spine ? vec(0, 0, 0) : displacement[PARENT[j]];
        displacement[j] = seen ? scale(sub(t->position[j], b->point[j]), share[j]) : carried;
        found[j] = seen ? b->point[j] : add(b->point[j], carried);
    }
    for (int k = 0; k < STIFF_COUNT; k++) stiff[k] = distance(b->point[STIFF[k][0]], b->point[STIFF[k][1]]);
    for (int round = 0; round < FIT_ROUNDS; round++) {
        for (int j = 1; j < BODY_JOINTS; j++) {
            int parent = PARENT[j];
            if (known_rotation(t, parent)) { /* a bone that a measured rotation turns */
                vec3 bone = rotate(t->rotation[parent], t->rest_offset[j]);
                correct(found, parent, j, sub(sub(found[j], found[parent]), bone));
            } else {
                keep_distance(found, parent, j, size[j]);
            }
        }
        for (int k = 0; k < STIFF_COUNT; k++) keep_distance(found, STIFF[k][0], STIFF[k][1], stiff[k]);
        for (int j = 0; j < BODY_JOINTS; j++)
            if (share[j] > 0.0F) found[j] = along(found[j], sub(t->position[j], found[j]), share[j]);
    }
}

/* Turn a joint that branches as a line across it and its spine were turned. */
static void turn_branch(const tracked *t, const body *b, const vec3 *found, int joint, int left, int right, int up,
                        prediction *p) {
    if (known_rotation(t, joint)) return;
    mat3 before = frame_of(sub(b->point[left], b->point[right]), sub(b->point[up], b->point[joint]));
    mat3 after = frame_of(sub(found[left], found[right]), sub(found[up], found[joint]));
    if (dot(before.z, before.z) < 0.5F || dot(after.z, after.z) < 0.5F) return; /* in one line */
    p->rotation[joint] = product(product(after, transpose(before)), p->rotation[joint]);
}

/* How far a placed body is from measured joints, in distances that the network expects, on average. The joint at which
 * it was placed does not count. 0: there are no others. */
static float missed_distance(const tracked *t, const body *b, const prediction *p) {
    const int placed = t->has_position[HEAD] ? HEAD : PELVIS;
    float sum = 0.0F, count = 0.0F;
    for (int j = 0; j < BODY_JOINTS; j++) {
        if (j == placed || !t->has_position[j]) continue;
        sum += distance(t->position[j], b->point[j]) / (p->error[j] + t->accuracy[j]);
        count += 1.0F;
    }
    return count > 0.0F ? sum / count : 0.0F;
}

void fit_prediction(const tracked *t, pose_state *s, prediction *p) {
    body b;
    vec3 found[BODY_JOINTS];
    mat3 before[BODY_JOINTS];
    bool changed = false;
    for (int j = 0; j < BODY_JOINTS; j++) {
        before[j] = p->rotation[j];
        b.rotation[j] = known_rotation(t, j) ? t->rotation[j] : p->rotation[j];
        changed = changed || t->has_position[j] != (s->had_position[j] != 0);
    }
    place(&b, t, p->head);
    place(&b, t, add(p->head, placement(&b, t, p)));
    p->missed = missed_distance(t, &b, p);
    find_places(t, &b, found);
    turn_branch(t, &b, found, PELVIS, LEFT_HIP, RIGHT_HIP, SPINE1, p);
    turn_branch(t, &b, found, SPINE3, LEFT_COLLAR, RIGHT_COLLAR, NECK, p);
    for (size_t k = 0; k < sizeof BONES / sizeof *BONES; k++) {
        int j = BONES[k][0], end = BONES[k][1];
        if (known_rotation(t, j)) continue;
        p->rotation[j] = turned_onto(p->rotation[j], sub(b.point[end], b.point[j]), sub(found[end], found[j]));
    }
    /* Joints are turned without a jump if a measured point came or went. */
    float left = t->at_once ? 0.0F : exponential(-t->interval / FIT_FADE);
    for (int j = 0; j < BODY_JOINTS; j++) {
        fitting *joint = &s->fitting[j];
        vec3 turn = turn_between(before[j], p->rotation[j]);
        if (changed && s->begun) joint->off = sub(joint->turn, turn);
        joint->off = scale(joint->off, left);
        joint->turn = add(turn, joint->off);
        p->rotation[j] = turned_by(before[j], joint->turn);
    }
}
