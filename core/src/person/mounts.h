/* Mountings of trackers, refined while the wearer moves. */
#ifndef BODYSENSE_MOUNTS_H
#define BODYSENSE_MOUNTS_H

#include "../base/internal.h"

#define REFINED_JOINTS 7 /* joints whose trackers are refined */
#define LIMB_BONES 3 /* thigh, shin and forearm, of both sides */
#define BELIEFS (3 * REFINED_JOINTS + LIMB_BONES)

typedef struct mounts {
    double due;                          /* s since distances were last taken in */
    double correction[REFINED_JOINTS][3]; /* m, in use: from the mount's joint, in the joint's axes */
    double mean[BELIEFS];                /* m, corrections as believed, then lengths of bones */
    double covariance[BELIEFS][BELIEFS]; /* m² */
} mounts;

void mounts_start(const bs_person *person, mounts *own);

/* Put joints in place of the trackers that they carry. */
void mounts_apply(const bs_person *person, tracked *seen);

/* Take in the distances of a frame, and put its joints where they are believed to be. */
void mounts_step(const bs_person *person, double interval, mounts *own, tracked *seen);

/* Keep what was learned if `after` wears its trackers as `before` did, else start anew. */
void mounts_update(const bs_person *before, const bs_person *after, mounts *own);

/* The mounts as believed now. */
void mounts_person(const mounts *own, bs_person *person);

#endif
