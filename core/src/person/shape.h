/* The shape space of adults: rest offsets = mean + coefficients · components, which are standard normal. */
#ifndef BODYSENSE_SHAPE_H
#define BODYSENSE_SHAPE_H

#include "../base/internal.h"

#define MOST_LENGTHS 64 /* that a shape is fitted to */

/* Known measures of a body: a height (NaN: unknown) and distances between points of the T-pose. */
typedef struct measurements {
    double height, height_deviation; /* m */
    bool is_stated;                  /* the wearer gave the height: it replaces the population's */
    int lengths;
    bs_length length[MOST_LENGTHS];
} measurements;

/* Rest offsets (m) of the likeliest body, and the standard deviation (m) of each bone's length.
 *
 * A height beyond the shape space's adults scales its tallest or its shortest. */
void likeliest_body(const bs_model *model, const measurements *known, double rest_offset[BS_POINTS][3],
                    double deviation[BS_POINTS]);

/* Height (m) of a point over the floor in the T-pose. */
double rest_height(double rest_offset[BS_POINTS][3], int point);

#endif
