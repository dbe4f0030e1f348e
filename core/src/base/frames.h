/* Kinematics and rotations of whole takes: many frames of any skeleton, in double precision. For Python's library, no
 * part of bodysense.h: engines get the places of all points with each step. */
#ifndef BODYSENSE_FRAMES_H
#define BODYSENSE_FRAMES_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define BS_EXPORTED
#else
#define BS_EXPORTED __attribute__((visibility("default")))
#endif

/* A skeleton: `joints` of its `points` come first, parents before their children, the root first. */
typedef struct bs_tree {
    int32_t joints, points;
    const int32_t *parent;     /* (points) */
    const double *rest_offset; /* (points, 3) m, from the parent; the root's is not used */
} bs_tree;

/* Write positions (frames, points, 3) m and world rotations (frames, joints, 4) wxyz of frames with root positions
 * (frames, 3) m and local rotations (frames, joints, 4). Nothing overlaps. */
BS_EXPORTED void bs_place_frames(const bs_tree *tree, size_t frames, const double *root, const double *rotation,
                                 double *position, double *world);

/* Rows of numbers, `step` doubles from one to the next. */
typedef struct bs_rows {
    const double *at;
    ptrdiff_t step;
} bs_rows;

/* Rotations row by row, as `bodysense.geometry.rotation` describes them: quaternions wxyz, vectors, shares. Results are
 * contiguous and overlap no argument. */
BS_EXPORTED void bs_multiply_rotations(size_t count, bs_rows a, bs_rows b, double *product);
BS_EXPORTED void bs_rotate_vectors(size_t count, bs_rows rotation, bs_rows vector, double *rotated);
BS_EXPORTED void bs_exp_rotations(size_t count, bs_rows vector, double *rotation);
BS_EXPORTED void bs_log_rotations(size_t count, bs_rows rotation, double *vector);
BS_EXPORTED void bs_mean_rotations(size_t count, bs_rows a, bs_rows b, bs_rows share, double *mean);

#endif
