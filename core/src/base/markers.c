/* Poses of takes by optical markers.
 *
 * The normal equations follow from moments of the markers that each joint moves: number, sum and sum of products of their
 * places p. The block of joints a above b is the sum of (p - b)·(p - a) I - (p - b) (p - a)ᵀ over b's markers. Joints on
 * different branches have no block, so eliminating children before their parents fills in none: a step costs what the
 * chains of the tree do, not the cube of its joints. */
#include "markers.h"
#include <math.h>
#include <string.h>

#include "doubles.h"

enum { MASS = 0, FIRST = 1, SECOND = 4, FORCE = 13, TORQUE = 16, MOMENTS = 19 }; /* of a joint */

/* Invert a symmetric positive definite matrix (3, 3). */
static void invert(const double m[9], double inverse[9]) {
    for (int row = 0; row < 3; row++)
        cross_doubles(m + 3 * ((row + 1) % 3), m + 3 * ((row + 2) % 3), inverse + 3 * row);
    const double determinant = m[0] * inverse[0] + m[1] * inverse[1] + m[2] * inverse[2];
    for (int k = 0; k < 9; k++)
        inverse[k] /= determinant;
}

/* Add the moments (joints, MOMENTS) of the markers that each joint moves, about `centre`. */
static void gather(const bs_worn_markers *worn, const double *position, const double *place, const double *turn,
                   const double centre[3], double *moments) {
    memset(moments, 0, (size_t)worn->joints * MOMENTS * sizeof(double));
    for (int32_t marker = 0; marker < worn->markers; marker++, position += 3) {
        if (!isfinite(position[0]) || !isfinite(position[1]) || !isfinite(position[2]))
            continue;
        const int32_t joint = worn->joint[marker];
        const double *axes = turn + 9 * joint, *offset = worn->offset + 3 * marker;
        const double share = 1 / (worn->noise[marker] * worn->noise[marker]);
        double *sum = moments + MOMENTS * joint, p[3], force[3], torque[3];
        for (int k = 0; k < 3; k++) {
            const double at = place[3 * joint + k] + axes[3 * k] * offset[0] + axes[3 * k + 1] * offset[1] +
                              axes[3 * k + 2] * offset[2];
            force[k] = (position[k] - at) * share;
            p[k] = at - centre[k]; /* near 0, which keeps the moments accurate */
        }
        cross_doubles(p, force, torque);
        sum[MASS] += share;
        for (int k = 0; k < 3; k++) {
            sum[FIRST + k] += share * p[k];
            sum[FORCE + k] += force[k];
            sum[TORQUE + k] += torque[k];
            for (int other = 0; other < 3; other++)
                sum[SECOND + 3 * k + other] += share * p[k] * p[other];
        }
    }
    for (int32_t joint = worn->joints - 1; joint > 0; joint--)
        for (int k = 0; k < MOMENTS; k++)
            moments[MOMENTS * worn->parent[joint] + k] += moments[MOMENTS * joint + k];
}

/* The block (3, 3) between the turns of joint b, with moments `sum`, and of a joint a above it, at places a and b. */
static void turns_block(const double *sum, const double b[3], const double a[3], double *block) {
    double trace = 0;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++)
            block[3 * column + row] = -(sum[SECOND + 3 * row + column] - b[row] * sum[FIRST + column] +
                                        (sum[MASS] * b[row] - sum[FIRST + row]) * a[column]);
    for (int k = 0; k < 3; k++)
        trace -= block[4 * k];
    for (int k = 0; k < 3; k++)
        block[4 * k] += trace;
}

/* The unknown above an unknown, -1 for the first: 0 is the root's translation, k + 1 the turn of joint k. */
static inline int32_t above(const int32_t *parent, int32_t unknown) {
    return unknown ? parent[unknown - 1] + 1 : -1;
}

static inline void subtract_product(const double a[9], const double *b, int columns, double *from) {
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < columns; column++)
            from[columns * row + column] -= a[row] * b[column] + a[3 + row] * b[columns + column] +
                                            a[6 + row] * b[2 * columns + column];
}

/* Solve the equations of a tree of n unknowns; the block (3, 3) of unknown k and one above it, i, is at k n + i. */
static void solve(int32_t n, const int32_t *parent, double *matrix, double *step) {
    for (int32_t k = n - 1; k >= 0; k--) {
        double inverse[9], right[3], *row = matrix + 9 * k * n;
        invert(row + 9 * k, inverse); /* symmetric: its transpose is itself */
        memcpy(right, step + 3 * k, sizeof right);
        memset(step + 3 * k, 0, sizeof right);
        subtract_product(inverse, right, 1, step + 3 * k);
        for (int c = 0; c < 3; c++)
            step[3 * k + c] = -step[3 * k + c];
        for (int32_t i = above(parent, k); i >= 0; i = above(parent, i)) {
            double solved[9] = {0};
            subtract_product(inverse, row + 9 * i, 3, solved);
            for (int c = 0; c < 9; c++)
                solved[c] = -solved[c];
            subtract_product(row + 9 * i, step + 3 * k, 1, step + 3 * i);
            for (int32_t j = i; j >= 0; j = above(parent, j))
                subtract_product(solved, row + 9 * j, 3, matrix + 9 * (i * n + j));
            memcpy(row + 9 * i, solved, sizeof solved);
        }
    }
    for (int32_t k = 0; k < n; k++)
        for (int32_t i = above(parent, k); i >= 0; i = above(parent, i))
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)
                    step[3 * k + r] -= matrix[9 * (k * n + i) + 3 * r + c] * step[3 * i + c];
}

void bs_step_to_markers(const bs_worn_markers *worn, size_t frames, const double *position, const double *place,
                        const double *turn, const double *weight, double *step, double *memory) {
    const int32_t joints = worn->joints, n = joints + 1;
    double *moments = memory + 9 * n * n;
    for (size_t frame = 0; frame < frames; frame++) {
        gather(worn, position, place, turn, place, moments);
        memset(memory, 0, 9 * sizeof(double));
        for (int k = 0; k < 3; k++) {
            memory[4 * k] = moments[MASS];
            step[k] += moments[FORCE + k];
        }
        for (int32_t joint = 0; joint < joints; joint++) {
            const double *sum = moments + MOMENTS * joint;
            double at[3], arm[3], turned[3], *row = memory + 9 * (joint + 1) * n;
            for (int k = 0; k < 3; k++) {
                at[k] = place[3 * joint + k] - place[k];
                arm[k] = sum[FIRST + k] - sum[MASS] * at[k];
            }
            cross_doubles(at, sum + FORCE, turned);
            for (int k = 0; k < 3; k++)
                step[3 * (joint + 1) + k] += sum[TORQUE + k] - turned[k];
            const double by_root[9] = {0, -arm[2], arm[1], arm[2], 0, -arm[0], -arm[1], arm[0], 0};
            memcpy(row, by_root, sizeof by_root);
            for (int32_t up = joint; up >= 0; up = worn->parent[up]) {
                const double from[3] = {place[3 * up] - place[0], place[3 * up + 1] - place[1],
                                        place[3 * up + 2] - place[2]};
                turns_block(sum, at, from, row + 9 * (up + 1));
            }
        }
        for (int32_t k = 0; k < n; k++)
            for (int c = 0; c < 3; c++)
                memory[9 * (k * n + k) + 4 * c] += weight[3 * k + c];
        solve(n, worn->parent, memory, step);
        position += 3 * worn->markers;
        place += 3 * joints;
        turn += 9 * joints;
        weight += 3 * n;
        step += 3 * n;
    }
}
