/* Vectors, matrices (3, 3), row by row, and quaternions wxyz in double precision, for bodies of any skeleton. */
#ifndef BODYSENSE_DOUBLES_H
#define BODYSENSE_DOUBLES_H

static inline void cross_doubles(const double a[3], const double b[3], double product[3]) {
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

static inline double dot_doubles(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void multiply_quaternions(const double a[4], const double b[4], double product[4]) {
    product[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    product[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    product[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    product[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

/* The matrix of a unit quaternion. */
static inline void matrix_of_quaternion(const double q[4], double m[9]) {
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    m[0] = w * w + x * x - y * y - z * z;
    m[1] = 2 * (x * y - w * z);
    m[2] = 2 * (x * z + w * y);
    m[3] = 2 * (x * y + w * z);
    m[4] = w * w - x * x + y * y - z * z;
    m[5] = 2 * (y * z - w * x);
    m[6] = 2 * (x * z - w * y);
    m[7] = 2 * (y * z + w * x);
    m[8] = w * w - x * x - y * y + z * z;
}

/* Add the product of matrices a (3, 3), b (3, columns), times `share`. */
static inline void add_product(const double *a, const double *b, int columns, double share, double *sum) {
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < columns; column++)
            sum[columns * row + column] += share * (a[3 * row] * b[column] + a[3 * row + 1] * b[columns + column] +
                                                    a[3 * row + 2] * b[2 * columns + column]);
}

static inline void transpose_doubles(const double m[9], double transposed[9]) {
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++) transposed[3 * column + row] = m[3 * row + column];
}

#endif
