/* Layers of the networks. */
#include "layers.h"

#include <string.h>

static void repeat(const float *bias, int size, int columns, float *to) {
    for (int c = 0; c < columns; c++) memcpy(to + (size_t)c * (size_t)size, bias, (size_t)size * sizeof *to);
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
    for (int k = 0; k < columns * rows; k++) w.units[k] = w.units[k] > 0.0F ? w.units[k] : 0.0F;
    repeat(b->out_bias, outputs, columns, out);
    model->kernel.multiply_table(&b->out, columns, w.units, (size_t)rows, out, (size_t)outputs);
}
