/* Rotations that measured points imply, and a head that is not tracked. */
#include "tracked.h"

const signed char KNUCKLE[2][KNUCKLES] = {{LEFT_INDEX1, LEFT_MIDDLE1, LEFT_RING1, LEFT_PINKY1},
                                          {RIGHT_INDEX1, RIGHT_MIDDLE1, RIGHT_RING1, RIGHT_PINKY1}};

/* Joints with several children: turned by points on them that are seen, along two vectors from `begin` to `end`. */
static const struct branch {
    signed char joint, first_begin, first_end, second_begin, second_end;
} BRANCHES[] = {
    {PELVIS, RIGHT_HIP, LEFT_HIP, PELVIS, SPINE1},
    {SPINE3, RIGHT_COLLAR, LEFT_COLLAR, SPINE3, NECK},
    {LEFT_WRIST, LEFT_WRIST, LEFT_MIDDLE1, LEFT_PINKY1, LEFT_INDEX1},
    {RIGHT_WRIST, RIGHT_WRIST, RIGHT_MIDDLE1, RIGHT_PINKY1, RIGHT_INDEX1},
};
enum { BRANCH_COUNT = sizeof(BRANCHES) / sizeof(BRANCHES[0]) };

/* Where a point of the joint's body is at rest, from the joint. */
static vec3 at_rest(const tracked *t, int joint, int point) {
    return point == joint ? vec(0, 0, 0) : t->rest_offset[point];
}

/* The knuckle of a hand that alone is hidden, from the other three and the wrist. Returns false if they are in one line,
 * or another one is hidden. */
static bool imply_knuckle(tracked *t, int hand, int hidden) {
    const signed char *knuckle = KNUCKLE[hand];
    int wrist = hand ? RIGHT_WRIST : LEFT_WRIST;
    int first = knuckle[hidden == 0 ? 1 : 0], last = knuckle[hidden == KNUCKLES - 1 ? hidden - 1 : KNUCKLES - 1];
    vec3 now = vec(0, 0, 0), rest = vec(0, 0, 0);
    if (!t->has_position[wrist]) return false;
    for (int k = 0; k < KNUCKLES; k++) {
        if (k == hidden) continue;
        if (!t->has_position[knuckle[k]]) return false;
        now = along(now, t->position[knuckle[k]], 1.0F / (KNUCKLES - 1));
        rest = along(rest, t->rest_offset[knuckle[k]], 1.0F / (KNUCKLES - 1));
    }
    mat3 before = frame_of(rest, sub(t->rest_offset[last], t->rest_offset[first]));
    mat3 after = frame_of(sub(now, t->position[wrist]), sub(t->position[last], t->position[first]));
    if (dot(before.z, before.z) < 0.5F || dot(after.z, after.z) < 0.5F) return false;
    vec3 off = rotate_back(before, sub(t->rest_offset[knuckle[hidden]], rest));
    t->knuckle[hand][hidden] = add(now, rotate(after, off));
    return true;
}

void find_knuckles(tracked *t) {
    for (int hand = 0; hand < 2; hand++) {
        bool all = true;
        for (int k = 0; k < KNUCKLES; k++) {
            t->knuckle[hand][k] = t->position[KNUCKLE[hand][k]];
            if (!t->has_position[KNUCKLE[hand][k]]) all = all && imply_knuckle(t, hand, k);
        }
        t->has_knuckles[hand] = all;
    }
}

/* Where a point is; sets `seen` to false if that is not known. */
static vec3 known_place(const tracked *t, int point, bool *seen) {
    for (int hand = 0; hand < 2; hand++)
        for (int k = 0; k < KNUCKLES; k++)
            if (KNUCKLE[hand][k] == point && t->has_knuckles[hand]) return t->knuckle[hand][k];
    *seen = *seen && t->has_position[point];
    return t->position[point];
}

void imply_rotations(tracked *t) {
    for (int k = 0; k < BRANCH_COUNT; k++) {
        const struct branch *b = &BRANCHES[k];
        bool seen = t->has_position[b->joint];
        vec3 first = sub(known_place(t, b->first_end, &seen), known_place(t, b->first_begin, &seen));
        vec3 second = sub(known_place(t, b->second_end, &seen), known_place(t, b->second_begin, &seen));
        t->implied[b->joint] = seen && !t->has_rotation[b->joint];
        if (!t->implied[b->joint]) continue;
        mat3 rest = frame_of(sub(at_rest(t, b->joint, b->first_end), at_rest(t, b->joint, b->first_begin)),
                             sub(at_rest(t, b->joint, b->second_end), at_rest(t, b->joint, b->second_begin)));
        mat3 now = frame_of(first, second);
        /* Points in one place or on one line determine no rotation. */
        if (dot(now.z, now.z) < 0.5F || dot(rest.z, rest.z) < 0.5F) {
            t->implied[b->joint] = false;
            continue;
        }
        t->rotation[b->joint] = product(now, transpose(rest));
    }
}

void place_head(tracked *t, const vec3 *before) {
    if (t->has_position[HEAD]) return;
    vec3 displacement = vec(0, 0, 0);
    int count = 0;
    for (int p = 0; p < BS_POINTS; p++) {
        if (!t->has_position[p]) continue;
        displacement = add(displacement, before ? sub(t->position[p], before[p]) : t->position[p]);
        count++;
    }
    if (count > 0) displacement = scale(displacement, 1.0F / (float)count);
    t->position[HEAD] = before ? add(before[HEAD], displacement) : displacement;
}
