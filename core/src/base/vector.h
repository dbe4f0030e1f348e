/* Vectors and rotations. A rotation is a matrix a ← b whose columns are the axes of b in a. */
#ifndef BODYSENSE_VECTOR_H
#define BODYSENSE_VECTOR_H

#include <math.h>

typedef struct vec3 {
    float x, y, z;
} vec3;

typedef struct mat3 { /* columns */
    vec3 x, y, z;
} mat3;

static const vec3 UP = {0.0F, 1.0F, 0.0F};

static inline vec3 vec(float x, float y, float z) { return (vec3){x, y, z}; }
static inline vec3 add(vec3 a, vec3 b) { return (vec3){a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline vec3 sub(vec3 a, vec3 b) { return (vec3){a.x - b.x, a.y - b.y, a.z - b.z}; }
static inline vec3 scale(vec3 a, float s) { return (vec3){a.x * s, a.y * s, a.z * s}; }
static inline vec3 along(vec3 a, vec3 b, float s) { return add(a, scale(b, s)); } /* a + s b */
static inline vec3 mix(vec3 a, vec3 b, float share) { return add(scale(a, 1.0F - share), scale(b, share)); }
static inline float dot(vec3 a, vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline float length(vec3 a) { return sqrtf(dot(a, a)); }
static inline float distance(vec3 a, vec3 b) { return length(sub(a, b)); }

static inline vec3 cross(vec3 a, vec3 b) {
    return (vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/* A vector of length one; zero stays zero. */
static inline vec3 unit(vec3 a) {
    float size = length(a);
    return size > 1e-12F ? scale(a, 1.0F / size) : vec(0, 0, 0);
}

/* The part of a vector across a unit normal. */
static inline vec3 across(vec3 a, vec3 normal) { return along(a, normal, -dot(a, normal)); }

/* Rotate a vector of b into a, for a ← b. */
static inline vec3 rotate(mat3 m, vec3 v) { return along(along(scale(m.x, v.x), m.y, v.y), m.z, v.z); }

/* Rotate a vector of a into b, for a ← b. */
static inline vec3 rotate_back(mat3 m, vec3 v) { return vec(dot(m.x, v), dot(m.y, v), dot(m.z, v)); }

/* a ← c from a ← b and b ← c. */
static inline mat3 product(mat3 a, mat3 b) { return (mat3){rotate(a, b.x), rotate(a, b.y), rotate(a, b.z)}; }

static inline mat3 transpose(mat3 m) {
    return (mat3){{m.x.x, m.y.x, m.z.x}, {m.x.y, m.y.y, m.z.y}, {m.x.z, m.y.z, m.z.z}};
}

static inline mat3 identity(void) { return (mat3){{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}; }

/* The rotation with x along `first` and y toward `second` (Gram-Schmidt). */
static inline mat3 frame_of(vec3 first, vec3 second) {
    vec3 x = unit(first), y = unit(across(second, x));
    return (mat3){x, y, cross(x, y)};
}

#endif
