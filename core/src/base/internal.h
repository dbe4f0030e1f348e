/* Types shared by the parts of a step. The rooms of a frame, in order:
 *
 *     step: clock, state → person: mounts, proportions → network: tracked points, features, layers (products: matrix) →
 *     step/pose → body: head, decaying offsets, fit to measured points, trunk → limbs: legs, feet, steps, arms →
 *     network: fingers, expected errors → step: local rotations
 */
#ifndef BODYSENSE_INTERNAL_H
#define BODYSENSE_INTERNAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "../../include/bodysense.h"
#include "skeleton.h"
#include "vector.h"

/* Tracked points of one person in one frame: joints in place of the trackers that they carry. Positions are relative to
 * `base`, which is in whole metres, so that precision does not depend on the distance from the world's origin. */
typedef struct tracked {
    double base[3];                 /* m, world */
    float interval;                 /* s since the frame before */
    float floor;                    /* m, height of the floor from base */
    bool has_position[BS_POINTS];
    bool has_rotation[BS_JOINTS];   /* measured */
    bool implied[BS_JOINTS];        /* of a joint that branches: measured points on it imply its rotation */
    vec3 position[BS_POINTS];       /* m, from base */
    mat3 rotation[BS_JOINTS];       /* world ← joint; measured or implied */
    vec3 knuckle[2][KNUCKLES];      /* m, from base: of `KNUCKLE`, measured or implied by the others */
    bool has_knuckles[2];           /* all of a hand's are known */
    bool stands_in[4];              /* points of a hand or foot replace a limb's end that is not measured */
    float waning;                   /* s by which a raised arm that is lost is nearer to be given up: `interval` at most */
    bool at_once;                   /* a point of the body is seen again, and the settings ease nothing */
    float accuracy[BS_POINTS];      /* m; UNTRACKED where not tracked */
    vec3 acceleration[BODY_JOINTS]; /* m/s², world */
    bool has_acceleration[BODY_JOINTS];
    vec3 rest_offset[BS_POINTS];    /* m, the proportions in use */
    float deviation[BS_POINTS];     /* m, of bones */
} tracked;

static inline bool known_rotation(const tracked *t, int joint) { return t->has_rotation[joint] || t->implied[joint]; }

/* Whether a point has a position, or is a joint with a known rotation. */
static inline bool is_measured(const tracked *t, int point) {
    return t->has_position[point] || (point < BODY_JOINTS && known_rotation(t, point));
}

#define UNTRACKED 1e4F /* m: the accuracy of a point that is not tracked */

/* The frame under the head: on the floor below it, turned as it looks. */
typedef struct head_frame {
    vec3 origin;        /* m, from base */
    float cosine, sine; /* of the turn about +Y, world ← frame */
} head_frame;

/* The network's prediction of a body, in the world. */
typedef struct prediction {
    mat3 rotation[BODY_JOINTS];  /* world ← joint */
    vec3 head;                   /* m, from base: where the head is if it is not tracked */
    float contact[BS_CONTACTS];  /* probability */
    float error[BODY_POINTS];  /* m, expected position error, of `placed_points` */
    float unlike[BODY_JOINTS];   /* how much the axes predicted for a body and for its mirror image differ */
    float missed;                /* mean distance of measured joints from it, in expected distances; 0: none */
} prediction;

/* A completed body. */
typedef struct body {
    mat3 rotation[BS_JOINTS]; /* world ← joint */
    vec3 point[BS_POINTS];    /* m, from base */
} body;

#endif
