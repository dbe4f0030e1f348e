/* Layers of the networks. */
#include "layers.h"

#include <string.h>

static void repeat(const float *bias, int size, int columns, float *to) {
    for (int c = 0; c < columns; c++) memcpy(to + (size_t)c * (size_t)size, bias, (size_t)size * sizeof *to);
}

/* Add the update of a product to y, for the columns that have it. */
static void add_update(const bs_model *model, const update *u, int columns, inputs x, float *y, size_t stride,
                       workspace w) {
    const int rank = u->inward.rows;
    if (!w.updated || !rank) return;
    memset(w.narrow, 0, (size_t)columns * (size_t)rank * sizeof *w.narrow);
    multiply_columns(model, &u->inward, columns, x, w.narrow, (size_t)rank);
    for (int k = 0; k < columns * rank; k++) w.narrow[k] *= w.updated[k / rank];
    quantise_columns(model, columns, w.narrow, rank, w.narrow_in);
    multiply_columns(model, &u->outward, columns, w.narrow_in, y, stride);
}

void run_recurrent(const bs_model *model, const recurrent *layer, int columns, inputs x, const float *before,
                   float *after, workspace w) {
    const int size = layer->of_state.inputs, rows = grouped(3 * size);
    const size_t stride = (size_t)rows;
    quantise_columns(model, columns, before, size, w.state);
    repeat(layer->input_bias, rows, columns, w.given);
    repeat(layer->state_bias, rows, columns, w.kept);
    multiply_columns(model, &layer->of_input, columns, x, w.given, stride);
    multiply_columns(model, &layer->of_state, columns, w.state, w.kept, stride);
    add_update(model, &layer->input_update, columns, x, w.given, stride, w);
    add_update(model, &layer->state_update, columns, w.state, w.kept, stride, w);
    for (size_t c = 0; c < (size_t)columns; c++) {
        const size_t state = c * (size_t)size;
        model->kernel.gates(w.given + c * stride, w.kept + c * stride, before + state, size, after + state);
    }
}

void run_branch(const bs_model *model, const branch *b, int columns, inputs hidden, inputs features, float *out,
                workspace w) {
    const int rows = grouped(b->of_hidden.rows), outputs = grouped(b->out.rows);
    repeat(b->bias, rows, columns, w.units);
    multiply_columns(model, &b->of_hidden, columns, hidden, w.units, (size_t)rows);
    multiply_columns(model, &b->of_features, columns, features, w.units, (size_t)rows);
    add_update(model, &b->hidden_update, columns, hidden, w.units, (size_t)rows, w);
    add_update(model, &b->features_update, columns, features, w.units, (size_t)rows, w);
    for (int k = 0; k < columns * rows; k++) w.units[k] = w.units[k] > 0.0F ? w.units[k] : 0.0F;
    repeat(b->out_bias, outputs, columns, out);
    model->kernel.multiply_table(&b->out, columns, w.units, (size_t)rows, out, (size_t)outputs);
}
