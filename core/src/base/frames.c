/* Kinematics of whole takes, and rotations of many rows. Sums keep the order of geometry/rotation.py in Python. */
#include "frames.h"
#include <float.h>
#include <math.h>
#include <string.h>

static inline void multiply(const double a[4], const double b[4], double product[4]) {
    product[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    product[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    product[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    product[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

/* The vector `from` plus a vector v that is turned by a quaternion. */
static inline void add_turned(const double from[3], const double q[4], const double v[3], double sum[3]) {
    double t[3];
    for (int k = 0; k < 3; k++) {
        int next = (k + 1) % 3, last = (k + 2) % 3;
        t[k] = 2 * (q[1 + next] * v[last] - q[1 + last] * v[next]);
    }
    for (int k = 0; k < 3; k++) {
        int next = (k + 1) % 3, last = (k + 2) % 3;
        sum[k] = v[k] + q[0] * t[k] + q[1 + next] * t[last] - q[1 + last] * t[next] + from[k];
    }
}

void bs_place_frames(const bs_tree *tree, size_t frames, const double *root, const double *rotation, double *position,
                     double *world) {
    const size_t joints = (size_t)tree->joints, points = (size_t)tree->points;
    for (size_t frame = 0; frame < frames; frame++) {
        memcpy(world, rotation, 4 * sizeof(double));
        memcpy(position, root, 3 * sizeof(double));
        for (size_t joint = 1; joint < joints; joint++)
            multiply(world + 4 * tree->parent[joint], rotation + 4 * joint, world + 4 * joint);
        for (size_t point = 1; point < points; point++) {
            const int32_t above = tree->parent[point];
            add_turned(position + 3 * above, world + 4 * above, tree->rest_offset + 3 * point, position + 3 * point);
        }
        root += 3;
        rotation += 4 * joints;
        position += 3 * points;
        world += 4 * joints;
    }
}

static inline void cross(const double a[3], const double b[3], double product[3]) {
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

/* Scale n numbers to unit length; zeros stay zeros. */
static inline void normalize(size_t n, double *a) {
    double squared = a[0] * a[0];
    for (size_t k = 1; k < n; k++)
        squared += a[k] * a[k];
    const double length = squared < 1e-12 * 1e-12 ? 0.0 : sqrt(squared);
    for (size_t k = 0; k < n; k++)
        a[k] /= length == 0 ? 1.0 : length;
}

void bs_multiply_rows(size_t count, const double *a, size_t a_step, const double *b, size_t b_step, double *product) {
    for (size_t row = 0; row < count; row++)
        multiply(a + row * a_step, b + row * b_step, product + 4 * row);
}

void bs_rotate_rows(size_t count, const double *q, size_t q_step, const double *v, size_t v_step, double *rotated) {
    for (size_t row = 0; row < count; row++) {
        const double *turn = q + row * q_step, *vector = v + row * v_step;
        double t[3], across[3];
        cross(turn + 1, vector, t);
        for (int k = 0; k < 3; k++)
            t[k] = 2 * t[k];
        cross(turn + 1, t, across);
        for (int k = 0; k < 3; k++)
            rotated[3 * row + (size_t)k] = vector[k] + turn[0] * t[k] + across[k];
    }
}

void bs_shortest_arcs(size_t count, const double *u, size_t u_step, const double *v, size_t v_step, double *arc) {
    for (size_t row = 0; row < count; row++) {
        double from[3], to[3], *turn = arc + 4 * row;
        memcpy(from, u + row * u_step, sizeof from);
        memcpy(to, v + row * v_step, sizeof to);
        normalize(3, from);
        normalize(3, to);
        const double cosine = from[0] * to[0] + from[1] * to[1] + from[2] * to[2];
        if (cosine < -1 + 4 * DBL_EPSILON) { /* a half turn about an axis at right angles */
            const double flat = fabs(from[0]) > 0.8, helper[3] = {1 - flat, flat, 0};
            turn[0] = 0;
            cross(from, helper, turn + 1);
            normalize(3, turn + 1);
        } else {
            turn[0] = 1 + cosine;
            cross(from, to, turn + 1);
            normalize(4, turn);
        }
    }
}

void bs_normalize_rows(size_t count, const double *a, size_t step, size_t width, double *scaled) {
    for (size_t row = 0; row < count; row++) {
        memcpy(scaled + row * width, a + row * step, width * sizeof(double));
        normalize(width, scaled + row * width);
    }
}

void bs_matrices_of_rows(size_t count, const double *q, size_t step, double *matrix) {
    for (size_t row = 0; row < count; row++, matrix += 9) {
        const double *turn = q + row * step, w = turn[0], x = turn[1], y = turn[2], z = turn[3];
        matrix[0] = 1 - 2 * (y * y + z * z), matrix[1] = 2 * (x * y - w * z), matrix[2] = 2 * (x * z + w * y);
        matrix[3] = 2 * (x * y + w * z), matrix[4] = 1 - 2 * (x * x + z * z), matrix[5] = 2 * (y * z - w * x);
        matrix[6] = 2 * (x * z - w * y), matrix[7] = 2 * (y * z + w * x), matrix[8] = 1 - 2 * (x * x + y * y);
    }
}
