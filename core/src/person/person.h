/* A wearer's proportions, inferred while the tracker runs. */
#ifndef BODYSENSE_PERSON_H
#define BODYSENSE_PERSON_H

#include "../base/internal.h"

#define EVIDENCE 20 /* measured lengths */
#define BINS 480    /* of 5 mm: lengths up to 2.4 m */

typedef struct proportions {
    double current[BS_POINTS][3];  /* m, rest offsets in use */
    double believed[BS_POINTS][3]; /* m, toward which those in use move */
    double deviation[BS_POINTS];   /* m, standard deviation of each bone's length */
    double since;                  /* s since lengths were last looked at */
    double due;                    /* s since `believed` was last fitted */
    double elapsed;                /* s of evidence */
    double head[3];                /* m, world, at the last look; NaN at first */
    double been[3];                /* m, world: where it has been of late */
    double speed;                  /* m/s, of the head */
    double walked;                 /* s for which an upright head moved along the floor */
    double tallest;                /* m: the stature that a body may not fall far below any more; 0 at first, below it while it may */
    double contradicting;          /* s for which the head has been too high for the known height */
    uint8_t seated;                /* 1: `tallest` may be a guess from a seat */
    uint8_t released;              /* 1: the head contradicted the known height, which counts no more */
    float seconds[EVIDENCE][BINS]; /* s for which each length was in each bin */
} proportions;

/* BS_OK, or why no person can be like that. */
bs_result check_person(const bs_person *person);

/* Set the proportions of a person before the first frame. */
void proportions_start(const bs_person *person, proportions *own);

/* Count the lengths of a frame, and move toward the likeliest body. */
void proportions_step(const bs_model *model, const bs_person *person, const tracked *seen, double interval,
                      proportions *own);

/* Keep the evidence after the known parts change: a known body is used at once, an inferred one is approached. */
void proportions_update(const bs_model *model, const bs_person *before, const bs_person *person, proportions *own);

#endif
