/* Layers of the networks, of several columns at once. */
#ifndef BODYSENSE_LAYERS_H
#define BODYSENSE_LAYERS_H

#include "model.h"

#define TOGETHER 16 /* people in one pass over the weights; hands and mirror images make two columns of each */

/* Vectors as products read them. */
typedef struct inputs {
    void *value;
    float *step;
    int steps; /* FEATURE_STEPS or STATE_STEPS */
} inputs;

/* Parts of scratch, one behind the other. Only counted if `memory` is NULL. */
typedef struct scratch {
    uint8_t *memory;
    size_t used;
} scratch;

static inline void *part_of(scratch *s, size_t bytes) {
    void *at = s->memory ? s->memory + s->used : NULL;
    s->used += (bytes + 63) / 64 * 64;
    return at;
}

static inline float *floats_of(scratch *s, int columns, int size) {
    return part_of(s, (size_t)columns * (size_t)size * sizeof(float));
}

/* Bytes of a vector as products read it. */
static inline size_t input_bytes(const bs_model *model, int size, int steps) {
    const int bundle = bundle_of(&model->kernel, steps);
    return (size_t)padded(size, bundle) * (bundle == PAIRS ? sizeof(int16_t) : sizeof(int8_t));
}

static inline inputs inputs_of(const bs_model *model, scratch *s, int columns, int size, int steps) {
    const size_t count = (size_t)columns;
    void *value = part_of(s, count * input_bytes(model, size, steps));
    return (inputs){value, part_of(s, count * (size_t)blocks_of(size) * sizeof(float)), steps};
}

/* Write vectors x, one after the other, as products read them. */
static inline void quantise_columns(const bs_model *model, int columns, const float *x, int size, inputs to) {
    const kernel *k = &model->kernel;
    quantiser *quantise = bundle_of(k, to.steps) == PAIRS ? k->quantise : k->quantise_bytes;
    for (size_t c = 0; c < (size_t)columns; c++)
        quantise(x + c * (size_t)size, size, to.steps, (uint8_t *)to.value + c * input_bytes(model, size, to.steps),
                 to.step + c * (size_t)blocks_of(size));
}

/* Add m x to y, of `stride` floats each. */
static inline void multiply_columns(const bs_model *model, const matrix *m, int columns, inputs x, float *y,
                                    size_t stride) {
    multiply_add *multiply = m->bundle == PAIRS ? model->kernel.multiply : model->kernel.multiply_bytes;
    multiply(m, columns, x.value, x.step, y, stride);
}

/* Room for the passing results of layers, and the columns that have updates. */
typedef struct workspace {
    float *given, *kept; /* columns × (3 × hidden), in whole groups: products with inputs, and with states */
    float *units;        /* columns × the widest branch, in whole groups */
    inputs state;        /* columns × hidden */
    float *narrow;       /* columns × rank: the first product of an update */
    inputs narrow_in;
    const float *updated; /* columns: 1 where updates are added, else 0. NULL: nowhere */
} workspace;

static inline workspace workspace_of(const bs_model *model, scratch *s, int columns, int hidden, int widest) {
    workspace w;
    w.given = floats_of(s, columns, grouped(3 * hidden));
    w.kept = floats_of(s, columns, grouped(3 * hidden));
    w.units = floats_of(s, columns, grouped(widest));
    w.state = inputs_of(model, s, columns, hidden, STATE_STEPS);
    w.narrow = floats_of(s, columns, model->rank);
    w.narrow_in = inputs_of(model, s, columns, model->rank, FEATURE_STEPS);
    w.updated = NULL;
    return w;
}

/* A recurrent layer: states before (columns × hidden) → after (columns × hidden). */
void run_recurrent(const bs_model *model, const recurrent *layer, int columns, inputs x, const float *before,
                   float *after, workspace w);

/* A branch: memory and inputs → outputs (columns × whole groups). */
void run_branch(const bs_model *model, const branch *b, int columns, inputs hidden, inputs features, float *out,
                workspace w);

/* Bytes of scratch that the finger network needs for `people` people. */
size_t finger_scratch(const bs_model *model, int people);

#endif
