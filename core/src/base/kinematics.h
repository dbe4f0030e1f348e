/* Placing bones, turning them onto directions, and two bones that reach a place. */
#ifndef BODYSENSE_KINEMATICS_H
#define BODYSENSE_KINEMATICS_H

#include "internal.h"

/* The turn that takes direction `before` onto `after` by the shortest way, applied to a rotation. */
mat3 turned_onto(mat3 rotation, vec3 before, vec3 after);

/* Rotation vector (rad, in a) of the turn that takes rotation a ← b `from` to `to`. */
vec3 turn_between(mat3 from, mat3 to);

/* A rotation after a further turn by a rotation vector. */
mat3 turned_by(mat3 rotation, vec3 turn);

/* The turn about +Y nearest to a rotation, as cosine and sine; (1, 0) if it has none. */
void heading_of(mat3 rotation, float *cosine, float *sine);

/* A vector of the world in a frame turned by a heading, and back. */
static inline vec3 into_heading(vec3 v, float c, float s) { return vec(c * v.x - s * v.z, v.y, s * v.x + c * v.z); }
static inline vec3 from_heading(vec3 v, float c, float s) { return vec(c * v.x + s * v.z, v.y, c * v.z - s * v.x); }

/* Place the points first..last-1 of a body by its rotations, from the place of point `anchor`, whose path to the root
 * is walked upward first. */
void place_points(body *b, const vec3 *rest_offset, int anchor, vec3 place, int points);

/* Two bones of lengths `upper` and `lower` (m) that reach from the origin to `end`, or point at it if it is too far. */
typedef struct two_bones {
    vec3 middle, end; /* m, from the start */
} two_bones;

/* `side` is where the middle should be, roughly; only its part across the way to the end counts. */
two_bones reach(vec3 end, float upper, float lower, vec3 side);

/* Height of a point over the floor in the rest pose (m). */
float standing_height(const tracked *t, int point);

#endif
