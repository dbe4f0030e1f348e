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
    quantise_columns(columns, before, size, w.state);
    repeat(layer->input_bias, rows, columns, w.given);
    repeat(layer->state_bias, rows, columns, w.kept);
    model->kernel.run(&layer->of_input, columns, x.value, x.step, w.given, stride);
    model->kernel.run(&layer->of_state, columns, w.state.value, w.state.step, w.kept, stride);
    for (int c = 0; c < columns; c++) {
        const float *given = w.given + (size_t)c * stride, *kept = w.kept + (size_t)c * stride;
        const float *old = before + (size_t)c * (size_t)size;
        float *new = after + (size_t)c * (size_t)size;
        for (int k = 0; k < size; k++) {
            const float reset = logistic(given[k] + kept[k]);
            const float update = logistic(given[size + k] + kept[size + k]);
            const float candidate = hyperbolic_tangent(given[2 * size + k] + reset * kept[2 * size + k]);
            new[k] = candidate + update * (old[k] - candidate);
        }
    }
}

void run_branch(const bs_model *model, const branch *b, int columns, inputs hidden, inputs features, float *out,
                workspace w) {
    const int rows = grouped(b->of_hidden.rows), outputs = grouped(b->out.rows);
    repeat(b->bias, rows, columns, w.units);
    model->kernel.run(&b->of_hidden, columns, hidden.value, hidden.step, w.units, (size_t)rows);
    model->kernel.run(&b->of_features, columns, features.value, features.step, w.units, (size_t)rows);
    for (int k = 0; k < columns * rows; k++) w.units[k] = w.units[k] > 0.0F ? w.units[k] : 0.0F;
    repeat(b->out_bias, outputs, columns, out);
    table_multiply_add(&b->out, columns, w.units, (size_t)rows, out, (size_t)outputs);
}
