/* Quaternions w, x, y, z of the interface, from and to matrices. */
#ifndef BODYSENSE_QUATERNION_H
#define BODYSENSE_QUATERNION_H

#include "vector.h"

/* The matrix of a quaternion of any length above zero. */
static inline mat3 matrix_of(const double q[4]) {
    double s = 2.0 / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    double w = q[0], x = q[1], y = q[2], z = q[3];
    mat3 m = {{(float)(1 - s * (y * y + z * z)), (float)(s * (x * y + w * z)), (float)(s * (x * z - w * y))},
              {(float)(s * (x * y - w * z)), (float)(1 - s * (x * x + z * z)), (float)(s * (y * z + w * x))},
              {(float)(s * (x * z + w * y)), (float)(s * (y * z - w * x)), (float)(1 - s * (x * x + y * y))}};
    return m;
}

/* The unit quaternion of a rotation, w ≥ 0. */
static inline void quaternion_of(mat3 m, double q[4]) {
    double a[3][3] = {{m.x.x, m.y.x, m.z.x}, {m.x.y, m.y.y, m.z.y}, {m.x.z, m.y.z, m.z.z}}; /* rows */
    double trace = a[0][0] + a[1][1] + a[2][2];
    if (trace > 0) {
        q[0] = 1 + trace;
        q[1] = a[2][1] - a[1][2];
        q[2] = a[0][2] - a[2][0];
        q[3] = a[1][0] - a[0][1];
    } else { /* by the largest component */
        int i = a[1][1] > a[0][0] ? 1 : 0;
        if (a[2][2] > a[i][i]) i = 2;
        int j = (i + 1) % 3, k = (i + 2) % 3;
        q[0] = a[k][j] - a[j][k];
        q[1 + i] = 1 + a[i][i] - a[j][j] - a[k][k];
        q[1 + j] = a[j][i] + a[i][j];
        q[1 + k] = a[k][i] + a[i][k];
    }
    double size = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (q[0] < 0) size = -size;
    for (int c = 0; c < 4; ++c) q[c] /= size;
}

#endif
