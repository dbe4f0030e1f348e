/* Rotations that measured points imply, and a head that is not tracked. */
#include "tracked.h"

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

void imply_rotations(tracked *t) {
    for (int k = 0; k < BRANCH_COUNT; k++) {
        const struct branch *b = &BRANCHES[k];
        bool seen = t->has_position[b->joint] && t->has_position[b->first_begin] && t->has_position[b->first_end] &&
                    t->has_position[b->second_begin] && t->has_position[b->second_end];
        t->implied[b->joint] = seen && !t->has_rotation[b->joint];
        if (!t->implied[b->joint]) continue;
        mat3 rest = frame_of(sub(at_rest(t, b->joint, b->first_end), at_rest(t, b->joint, b->first_begin)),
                             sub(at_rest(t, b->joint, b->second_end), at_rest(t, b->joint, b->second_begin)));
        mat3 now = frame_of(sub(t->position[b->first_end], t->position[b->first_begin]),
                            sub(t->position[b->second_end], t->position[b->second_begin]));
        /* Points in one place or in one line tell no rotation. */
        if (dot(now.z, now.z) < 0.5F || dot(rest.z, rest.z) < 0.5F) {
            t->implied[b->joint] = false;
            continue;
        }
        t->rotation[b->joint] = product(now, transpose(rest));
    }
}

void place_head(tracked *t, const vec3 *before) {
    if (t->has_position[HEAD]) return;
    vec3 moved = vec(0, 0, 0);
    int count = 0;
    for (int p = 0; p < BS_POINTS; p++) {
        if (!t->has_position[p]) continue;
        moved = add(moved, before ? sub(t->position[p], before[p]) : t->position[p]);
        count++;
    }
    if (count > 0) moved = scale(moved, 1.0F / (float)count);
    t->position[HEAD] = before ? add(before[HEAD], moved) : moved;
}
