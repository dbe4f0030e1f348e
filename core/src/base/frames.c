/* Kinematics and rotations of whole takes. Sums keep the order of `bodysense.geometry.rotation` in Python. */
#include "frames.h"

#include <math.h>
#include <string.h>

#include "doubles.h"

#define TINY 1e-24       /* squared length below which a quaternion is not normalised */
#define SMALL_TURN 1e-8  /* rad², squared angle below which sines are taken from their series */
#define SMALL_SINE 1e-14 /* squared sine of half an angle below which its logarithm is linear */

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
            multiply_quaternions(world + 4 * tree->parent[joint], rotation + 4 * joint, world + 4 * joint);
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

void bs_multiply_rotations(size_t count, bs_rows a, bs_rows b, double *product) {
    for (size_t n = 0; n < count; n++, a.at += a.step, b.at += b.step, product += 4) multiply_quaternions(a.at, b.at, product);
}

static inline double cross_part(const double a[3], const double b[3], int k) {
    const int next = (k + 1) % 3, last = (k + 2) % 3;
    return a[next] * b[last] - a[last] * b[next];
}

void bs_rotate_vectors(size_t count, bs_rows rotation, bs_rows vector, double *rotated) {
    for (size_t n = 0; n < count; n++, rotation.at += rotation.step, vector.at += vector.step, rotated += 3) {
        const double *axis = rotation.at + 1;
        double t[3];
        for (int k = 0; k < 3; k++) t[k] = 2 * cross_part(axis, vector.at, k);
        for (int k = 0; k < 3; k++) rotated[k] = vector.at[k] + rotation.at[0] * t[k] + cross_part(axis, t, k);
    }
}

void bs_exp_rotations(size_t count, bs_rows vector, double *rotation) {
    for (size_t n = 0; n < count; n++, vector.at += vector.step, rotation += 4) {
        const double *v = vector.at, squared = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], angle = sqrt(squared);
        const int small = squared < SMALL_TURN;
        const double scale = small ? 0.5 - squared / 48 : sin(angle / 2) / angle;
        rotation[0] = small ? 1 - squared / 8 + squared * squared / 384 : cos(angle / 2);
        for (int k = 0; k < 3; k++) rotation[1 + k] = v[k] * scale;
    }
}

void bs_log_rotations(size_t count, bs_rows rotation, double *vector) {
    for (size_t n = 0; n < count; n++, rotation.at += rotation.step, vector += 3) {
        const double *q = rotation.at, sign = q[0] < 0 ? -1 : 1, w = sign * q[0];
        const double squared = q[1] * q[1] + q[2] * q[2] + q[3] * q[3], sine = sqrt(squared);
        const double scale = squared < SMALL_SINE ? 2 / (w == 0 ? 1 : w) : 2 * atan2(sine, w) / sine;
        for (int k = 0; k < 3; k++) vector[k] = sign * q[1 + k] * scale;
    }
}

void bs_mean_rotations(size_t count, bs_rows a, bs_rows b, bs_rows share, double *mean) {
    for (size_t n = 0; n < count; n++, a.at += a.step, b.at += b.step, share.at += share.step, mean += 4) {
        double product[4], squared = 0, cosine = 0;
        for (int k = 0; k < 4; k++) cosine += a.at[k] * b.at[k];
        const double own = 1 - *share.at, other = cosine < 0 ? -*share.at : *share.at;
        for (int k = 0; k < 4; k++) product[k] = own * a.at[k] + other * b.at[k], squared += product[k] * product[k];
        const double length = squared < TINY ? 1 : sqrt(squared), sign = product[0] < 0 ? -1 : 1;
        for (int k = 0; k < 4; k++) mean[k] = sign * (product[k] / length);
    }
}
