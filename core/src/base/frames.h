/* Kinematics of whole takes: many frames of any skeleton, in double precision. For Python's library, no part of
 * bodysense.h: engines get the places of all points with each step. */
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

#endif
