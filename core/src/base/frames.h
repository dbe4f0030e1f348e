/* Kinematics of whole takes, many frames of any skeleton, and rotations of many rows; in double precision. For Python's
 * library, no part of bodysense.h: engines get the places of all points with each step. */
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

/* Rotations of `count` rows; a row's first number is `step` numbers behind that of the row before, 0 if all rows are one.
 * Write products (count, 4) of quaternions wxyz; vectors (count, 3) turned by quaternions; the smallest rotations
 * (count, 4) that take directions `u` to directions `v`; matrices (count, 3, 3) of quaternions; rows (count, width)
 * scaled to unit length. The functions of geometry/rotation.py that they stand in for give equal bits. Nothing
 * overlaps. */
BS_EXPORTED void bs_multiply_rows(size_t count, const double *a, size_t a_step, const double *b, size_t b_step,
                                  double *product);
BS_EXPORTED void bs_rotate_rows(size_t count, const double *q, size_t q_step, const double *v, size_t v_step,
                                double *rotated);
BS_EXPORTED void bs_shortest_arcs(size_t count, const double *u, size_t u_step, const double *v, size_t v_step,
                                  double *arc);
BS_EXPORTED void bs_matrices_of_rows(size_t count, const double *q, size_t step, double *matrix);
BS_EXPORTED void bs_normalize_rows(size_t count, const double *a, size_t step, size_t width, double *scaled);

#endif
