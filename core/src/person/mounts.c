/* One second of calibration locates a tracker's joint only in part: standing still does not show how a body's height
 * is divided between legs and torso. Motion shows more: a bone has one length however its two ends turn, and a
 * leg is never longer than thigh and shin together. A Kalman filter holds corrections of the joints' places, in the
 * joints' axes, and lengths of bones. Bodies change so slowly that nothing jumps. */
#include "mounts.h"

#include <string.h>

#include "../base/maths.h"
#include "../base/quaternion.h"
#include "../constants.h"

enum bone { THIGH, SHIN, FOREARM };

static const signed char JOINT[REFINED_JOINTS] = {
    PELVIS, LEFT_KNEE, RIGHT_KNEE, LEFT_ANKLE, RIGHT_ANKLE, LEFT_ELBOW, RIGHT_ELBOW};
static const double UNSURE[REFINED_JOINTS][3] = {
    /* m: standard deviation of a calibrated place: sideways, up, forward */
    {0.008, 0.022, 0.012}, {0.01, 0.016, 0.012}, {0.01, 0.016, 0.012}, {0.01, 0.008, 0.012},
    {0.01, 0.008, 0.012}, {0.016, 0.012, 0.012}, {0.016, 0.012, 0.012},
};
static const signed char BONE_END[LIMB_BONES] = {LEFT_KNEE, LEFT_ANKLE, LEFT_WRIST};

/* A distance between points that move with two tracked joints, and the bones whose lengths add up to it. */
static const struct distance {
    signed char start, end;
    signed char offset;  /* the point of the start's body that counts; -1: the joint itself */
    signed char without; /* counts only if this joint is not tracked; -1: always */
    signed char first, last; /* bones */
    bool at_most;        /* else always so long */
} DISTANCE[] = {
    {PELVIS, LEFT_KNEE, LEFT_HIP, -1, THIGH, THIGH, false}, {PELVIS, LEFT_ANKLE, LEFT_HIP, LEFT_KNEE, THIGH, SHIN, true},
    {LEFT_KNEE, LEFT_ANKLE, -1, -1, SHIN, SHIN, false}, {LEFT_ELBOW, LEFT_WRIST, -1, -1, FOREARM, FOREARM, false},
    {PELVIS, RIGHT_KNEE, RIGHT_HIP, -1, THIGH, THIGH, false}, {PELVIS, RIGHT_ANKLE, RIGHT_HIP, RIGHT_KNEE, THIGH, SHIN, true},
    {RIGHT_KNEE, RIGHT_ANKLE, -1, -1, SHIN, SHIN, false}, {RIGHT_ELBOW, RIGHT_WRIST, -1, -1, FOREARM, FOREARM, false},
};

/* Which of the joints with corrections this is; -1 if none. */
static int refined_index(int joint) {
    for (int w = 0; w < REFINED_JOINTS; ++w)
        if (JOINT[w] == joint) return w;
    return -1;
}

static bool is_positional(const bs_mount *mount) { return mount->worn && !mount->rotation_only; }

/* Whether the person wears a tracker whose mounting can be refined. */
static bool any_positional(const bs_person *person) {
    for (int w = 0; w < REFINED_JOINTS; ++w)
        if (is_positional(&person->mount[JOINT[w]])) return true;
    return false;
}

void mounts_start(const bs_person *person, mounts *own) {
    memset(own, 0, sizeof *own);
    for (int b = 0; b < LIMB_BONES; ++b) {
        const double *offset = person->rest_offset[BONE_END[b]];
        double unsure = fmax(person->deviation[BONE_END[b]], MOUNT_BONE_LEAST);
        own->mean[3 * REFINED_JOINTS + b] = sqrt(offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]);
        own->covariance[3 * REFINED_JOINTS + b][3 * REFINED_JOINTS + b] = unsure * unsure;
    }
    for (int w = 0; w < REFINED_JOINTS; ++w)
        for (int c = 0; c < 3 && is_positional(&person->mount[JOINT[w]]); ++c)
            own->covariance[3 * w + c][3 * w + c] = UNSURE[w][c] * UNSURE[w][c];
}

void mounts_apply(const bs_person *person, tracked *seen) {
    for (int j = 0; j < BS_JOINTS; ++j) {
        const bs_mount *mount = &person->mount[j];
        if (!mount->worn || !seen->has_rotation[j] || !(seen->has_position[j] || mount->rotation_only)) continue;
        seen->rotation[j] = product(seen->rotation[j], transpose(matrix_of(mount->rotation)));
        if (mount->rotation_only) continue;
        vec3 offset = vec((float)mount->translation[0], (float)mount->translation[1], (float)mount->translation[2]);
        seen->position[j] = sub(seen->position[j], rotate(seen->rotation[j], offset));
    }
}

/* Components of a vector of the world in a joint's axes. */
static void in_axes(const mat3 *axes, const double v[3], double own[3]) {
    own[0] = v[0] * axes->x.x + v[1] * axes->x.y + v[2] * axes->x.z;
    own[1] = v[0] * axes->y.x + v[1] * axes->y.y + v[2] * axes->y.z;
    own[2] = v[0] * axes->z.x + v[1] * axes->z.y + v[2] * axes->z.z;
}

/* Components in the world of a vector in a joint's axes. */
static void in_world(const mat3 *axes, const double v[3], double world[3]) {
    world[0] = v[0] * axes->x.x + v[1] * axes->y.x + v[2] * axes->z.x;
    world[1] = v[0] * axes->x.y + v[1] * axes->y.y + v[2] * axes->z.y;
    world[2] = v[0] * axes->x.z + v[1] * axes->y.z + v[2] * axes->z.z;
}

/* Take in one distance: a step of the filter. */
static void take_in(const struct distance *one, const bs_person *person, const tracked *seen, mounts *own) {
    int ends[2] = {one->start, one->end};
    double apart[3], world_offset[3], direction[3], slope[BELIEFS] = {0}, spread[BELIEFS], far = 0.0, expected = 0.0;
    vec3 start = seen->position[one->start], end = seen->position[one->end];
    apart[0] = (double)end.x - (double)start.x;
    apart[1] = (double)end.y - (double)start.y;
    apart[2] = (double)end.z - (double)start.z;
    if (one->offset >= 0) {
        in_world(&seen->rotation[one->start], person->rest_offset[one->offset], world_offset);
        for (int c = 0; c < 3; ++c) apart[c] -= world_offset[c];
    }
    for (int e = 0; e < 2; ++e) {
        int w = refined_index(ends[e]);
        if (w < 0) continue;
        in_world(&seen->rotation[ends[e]], &own->mean[3 * w], world_offset);
        for (int c = 0; c < 3; ++c) apart[c] += e == 0 ? -world_offset[c] : world_offset[c];
    }
    for (int c = 0; c < 3; ++c) far += apart[c] * apart[c];
    far = sqrt(far);
    for (int c = 0; c < 3; ++c) direction[c] = apart[c] / fmax(far, 0.01);
    for (int e = 0; e < 2; ++e) {
        int w = refined_index(ends[e]);
        if (w < 0) continue;
        in_axes(&seen->rotation[ends[e]], direction, &slope[3 * w]);
        for (int c = 0; c < 3 && e == 0; ++c) slope[3 * w + c] = -slope[3 * w + c];
    }
    double excess = far, noise = MOUNT_NOISE;
    for (int b = one->first; b <= one->last; ++b) {
        slope[3 * REFINED_JOINTS + b] = -1.0;
        excess -= own->mean[3 * REFINED_JOINTS + b];
    }
    for (int i = 0; i < BELIEFS; ++i) {
        spread[i] = 0.0;
        for (int j = 0; j < BELIEFS; ++j) spread[i] += own->covariance[i][j] * slope[j];
    }
    for (int i = 0; i < BELIEFS; ++i) expected += slope[i] * spread[i];
    expected = fmax(expected, 0.0);
    if (one->at_most && excess < 0) {
        if (-excess > MOUNT_BENT + 2 * sqrt(expected)) return;
        noise = MOUNT_SHORT_NOISE;
    }
    double variance = expected + noise * noise;
    if (!(fabs(excess) <= MOUNT_FARTHEST * sqrt(variance))) return;
    for (int i = 0; i < 3 * REFINED_JOINTS; ++i)
        if (!(fabs(own->mean[i] - spread[i] * (excess / variance)) <= MOUNT_MOST)) return;
    for (int i = 0; i < BELIEFS; ++i) {
        own->mean[i] -= spread[i] * (excess / variance);
        for (int j = 0; j < BELIEFS; ++j) own->covariance[i][j] -= spread[i] * spread[j] / variance;
    }
}

void mounts_step(const bs_person *person, double interval, mounts *own, tracked *seen) {
    if (!any_positional(person)) return;
    own->due += interval;
    if (own->due >= MOUNT_INTERVAL) {
        for (int i = 0; i < BELIEFS; ++i)
            if (own->covariance[i][i] > 0) own->covariance[i][i] += MOUNT_SLIP * MOUNT_SLIP * own->due;
        for (size_t d = 0; d < sizeof DISTANCE / sizeof *DISTANCE; ++d) {
            const struct distance *one = &DISTANCE[d];
            if (!is_positional(&person->mount[one->start]) && !is_positional(&person->mount[one->end])) continue;
            if (one->without >= 0 && seen->has_position[one->without]) continue;
            if (seen->has_position[one->start] && seen->has_rotation[one->start] && seen->has_position[one->end] &&
                seen->has_rotation[one->end])
                take_in(one, person, seen, own);
        }
        own->due = 0.0;
    }
    double share = 1.0 - exponential_double(-LN_2 * interval / MOUNT_HALF_LIFE);
    for (int w = 0; w < REFINED_JOINTS; ++w) {
        double *correction = own->correction[w];
        for (int c = 0; c < 3; ++c) correction[c] += share * (own->mean[3 * w + c] - correction[c]);
        int j = JOINT[w];
        if (seen->has_position[j] && seen->has_rotation[j])
            seen->position[j] = add(seen->position[j],
                                    rotate(seen->rotation[j],
                                           vec((float)correction[0], (float)correction[1], (float)correction[2])));
    }
}

void mounts_update(const bs_person *before, const bs_person *after, mounts *own) {
    for (int j = 0; j < BS_JOINTS; ++j) {
        const bs_mount *was = &before->mount[j], *is = &after->mount[j];
        bool same = !was->worn == !is->worn;
        if (same && is->worn) {
            same = !was->rotation_only == !is->rotation_only;
            for (int c = 0; c < 3; ++c) same = same && was->translation[c] == is->translation[c];
            for (int c = 0; c < 4; ++c) same = same && was->rotation[c] == is->rotation[c];
        }
        if (!same) {
            mounts_start(after, own);
            return;
        }
    }
}

void mounts_person(const mounts *own, bs_person *person) {
    for (int w = 0; w < REFINED_JOINTS; ++w) {
        bs_mount *mount = &person->mount[JOINT[w]];
        for (int c = 0; c < 3 && is_positional(mount); ++c) mount->translation[c] -= own->mean[3 * w + c];
    }
}
