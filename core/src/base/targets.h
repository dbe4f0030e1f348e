/* Inverse kinematics of any skeleton, in double precision: bodies whose points are near targets. For Python's library, no
 * part of bodysense.h. */
#ifndef BODYSENSE_TARGETS_H
#define BODYSENSE_TARGETS_H

#include "frames.h"

/* A body, and the pull of its joints toward a relaxed posture. */
typedef struct bs_posable {
    bs_tree tree;
    const double *lever;     /* (joints) m, makes turns comparable with distances */
    const double *stiffness; /* (joints, 3) m, of each component of `relaxed`; the root's are 0 */
    const double *relaxed;   /* (joints, 3) twice the vector part of the local rotations at rest */
} bs_posable;

/* Levenberg and Marquardt's damping of steps, and when to stop. */
typedef struct bs_descent {
    double tolerance;                            /* m, of a linear step: root mean square of all points */
    double damping, first_damping, most_damping; /* of the first step, after a step that raised the cost, and at most */
    int32_t steps;                               /* at most; 0: only place the points */
} bs_descent;

typedef struct bs_targets {
    const double *position;        /* (points, 3) m, world */
    const double *weight;          /* (points) 0: none */
    const double *rotation;        /* (joints, 4) wxyz, world ← joint */
    const double *rotation_weight; /* (joints) m²/rad², 0: none. NULL: no rotations */
} bs_targets;

/* A body in the world: `root` and `world` are read and replaced, the others are written. */
typedef struct bs_reached {
    double *root;         /* (3) m */
    double *world;        /* (joints, 4) wxyz, world ← joint */
    double *local;        /* (joints, 4) wxyz, w ≥ 0, parent ← joint */
    double *position;     /* (points, 3) m */
    double *tension;      /* (points) outward pull of the targets on every bone but the root's; read if `has_tension` */
    double cost;          /* m², weighted squared distances to the targets */
    int32_t has_tension;  /* 1 if `tension` is that of the frame before */
} bs_reached;

/* Doubles of memory that `bs_reach_targets` needs. */
BS_EXPORTED size_t bs_reach_memory(const bs_tree *tree);

/* Move a body to a least sum of weighted squared distances from its targets. Nothing overlaps. */
BS_EXPORTED void bs_reach_targets(const bs_posable *body, const bs_descent *descent, const bs_targets *targets,
                                  bs_reached *reached, double *memory);

#endif
