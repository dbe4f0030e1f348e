/* Layers of the networks, of several columns at once. */
#ifndef BODYSENSE_LAYERS_H
#define BODYSENSE_LAYERS_H

#include "model.h"

#define TOGETHER 16 /* people in one pass over the weights; hands and mirror images make two columns of each */

/* Vectors as products read them. */
typedef struct inputs {
    int16_t *value;
    float *step;
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

static inline inputs inputs_of(scratch *s, int columns, int size) {
    const size_t count = (size_t)columns;
    int16_t *value = part_of(s, count * (size_t)paired(size) * sizeof *value);
    return (inputs){value, part_of(s, count * (size_t)blocks_of(size) * sizeof(float))};
}

/* Vectors x, one behind the other, as products read them. */
static inline void quantise_columns(const bs_model *model, int columns, const float *x, int size, inputs to) {
    for (int c = 0; c < columns; c++) {
        const size_t column = (size_t)c;
        model->kernel.quantise(x + column * (size_t)size, size, to.value + column * (size_t)paired(size),
                 to.step + column * (size_t)blocks_of(size));
    }
}

/* Room for the passing results of layers. */
typedef struct workspace {
    float *given, *kept; /* columns × (3 × hidden), in whole groups: products with inputs, and with states */
    float *units;        /* columns × the widest branch, in whole groups */
    inputs state;        /* columns × hidden */
} workspace;

static inline workspace workspace_of(scratch *s, int columns, int hidden, int widest) {
    workspace w;
    w.given = floats_of(s, columns, grouped(3 * hidden));
    w.kept = floats_of(s, columns, grouped(3 * hidden));
    w.units = floats_of(s, columns, grouped(widest));
    w.state = inputs_of(s, columns, hidden);
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
