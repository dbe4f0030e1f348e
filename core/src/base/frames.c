/* Kinematics of whole takes. Sums keep the order of `quaternion_multiply` and `quaternion_rotate` in Python. */
#include "frames.h"
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
