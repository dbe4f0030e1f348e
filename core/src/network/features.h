/* Inputs of the body's network, and its frame of reference. */
#ifndef BODYSENSE_FEATURES_H
#define BODYSENSE_FEATURES_H

#include "model.h"

#define READ_POINTS (BODY_POINTS + 2) /* and the middle of each hand's knuckles */
#define SPINNING 3                      /* head and wrists, whose angular velocity is an input */

/* Memory of the networks for one person; all of it floats. */
typedef struct input_memory {
    float begun;         /* 0 before the first frame, then 1 */
    float elapsed;       /* s since the networks' memories last advanced */
    float advances;      /* 1 if they advance in this frame */
    float cosine, sine;  /* of the heading in the frame before */
    vec3 wrist[2];       /* m, from base: of the body of the frame before */
    vec3 place[READ_POINTS]; /* m, from base: points when memories last advanced */
    vec3 axis[SPINNING][2];  /* likewise x and y axes of head and wrists, world */
    float had_place[READ_POINTS], had_axes[SPINNING]; /* 1 where these were tracked */
} input_memory;

/* The hidden states follow it: of the body's layers, of those for the mirror image, of both hands. */
static inline float *hidden_of(float *memory) { return memory + sizeof(input_memory) / sizeof(float); }

/* Sources of the features. */
typedef struct reading {
    float size;     /* the wearer's stature as a share of the reference's */
    float interval; /* s since memories last advanced */
    vec3 place[READ_POINTS];       /* m, from base */
    bool has_place[READ_POINTS];
    bool has_axes[BODY_JOINTS];
} reading;

/* The frame under the head of one person, from whatever is tracked. */
head_frame find_frame(const tracked *seen, const input_memory *last);

/* Height of a skeleton's head above its soles at rest, as a share of the reference's. */
float stature(const vec3 rest_offset[BS_POINTS]);

/* Return the sources of one person's features. */
reading read_person(const tracked *seen, const input_memory *last);

/* Write features of a body, or of its mirror image at the plane x = 0 of the frame under the head. */
void write_features(const bs_model *model, const tracked *seen, const reading *read, head_frame frame,
                    const input_memory *last, bool mirrored, float *out);

static inline vec3 to_frame(head_frame f, vec3 v) {
    return vec(f.cosine * v.x - f.sine * v.z, v.y, f.sine * v.x + f.cosine * v.z);
}

static inline vec3 from_frame(head_frame f, vec3 v) {
    return vec(f.cosine * v.x + f.sine * v.z, v.y, f.cosine * v.z - f.sine * v.x);
}

static inline vec3 reflected(vec3 v) { return vec(-v.x, v.y, v.z); }

static inline vec3 clamped(vec3 v, float most) {
    return vec(clamp(v.x, -most, most), clamp(v.y, -most, most), clamp(v.z, -most, most));
}

static inline float *put(float *to, vec3 v) {
    to[0] = v.x, to[1] = v.y, to[2] = v.z;
    return to + 3;
}

/* Both axes of a joint: component by component. */
static inline float *put_axes(float *to, vec3 x, vec3 y) {
    to[0] = x.x, to[1] = y.x, to[2] = x.y, to[3] = y.y, to[4] = x.z, to[5] = y.z;
    return to + 6;
}

#endif
