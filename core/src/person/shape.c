#include "shape.h"

#include "../network/model.h"
#include "../constants.h"

/* A lower triangle. */
typedef struct triangle {
    double row[SHAPE_SIZE][SHAPE_SIZE];
} triangle;

/* Where a point is from the root, in a table (65, 3) of offsets. */
static void place_of(const double *offset, int point, double place[3]) {
    for (int c = 0; c < 3; ++c) place[c] = 0.0;
    for (; point != PELVIS; point = PARENT[point])
        for (int c = 0; c < 3; ++c) place[c] += offset[3 * point + c];
}

/* The vector that a measurement is the length of, in a table of offsets; the last is the height. */
static void vector_of(const double *offset, const measurements *known, int m, double vector[3]) {
    double start[3];
    if (m == known->lengths) {
        place_of(offset, HEAD_TOP, vector);
        vector[0] = vector[2] = 0.0;
        vector[1] += offset[1];
        return;
    }
    place_of(offset, known->length[m].start, start);
    place_of(offset, known->length[m].end, vector);
    for (int c = 0; c < 3; ++c) vector[c] -= start[c];
}

static void factorize(triangle *a) { /* Cholesky: a = l lᵀ */
    for (int i = 0; i < SHAPE_SIZE; ++i)
        for (int j = 0; j <= i; ++j) {
            double sum = a->row[i][j];
            for (int k = 0; k < j; ++k) sum -= a->row[i][k] * a->row[j][k];
            a->row[i][j] = i == j ? sqrt(sum) : sum / a->row[j][j];
        }
}

static void solve_lower(const triangle *l, double x[SHAPE_SIZE]) { /* l⁻¹ x */
    for (int i = 0; i < SHAPE_SIZE; ++i) {
        for (int k = 0; k < i; ++k) x[i] -= l->row[i][k] * x[k];
        x[i] /= l->row[i][i];
    }
}

static void solve_upper(const triangle *l, double x[SHAPE_SIZE]) { /* l⁻ᵀ x */
    for (int i = SHAPE_SIZE - 1; i >= 0; --i) {
        for (int k = i + 1; k < SHAPE_SIZE; ++k) x[i] -= l->row[k][i] * x[k];
        x[i] /= l->row[i][i];
    }
}

/* Maximum a posteriori coefficients under the standard normal prior, and the factor of their precision (Laplace). */
static void fit(const bs_model *model, const measurements *known, double coefficient[SHAPE_SIZE], triangle *factor) {
    const double *mean = model_shape_mean(model), *component = model_shape_components(model);
    int count = known->lengths + (isfinite(known->height) ? 1 : 0);
    double start[MOST_LENGTHS + 1][3], slope[MOST_LENGTHS + 1][SHAPE_SIZE][3];
    for (int m = 0; m < count; ++m) {
        vector_of(mean, known, m, start[m]);
        for (int k = 0; k < SHAPE_SIZE; ++k) vector_of(component + k * 3 * BS_POINTS, known, m, slope[m][k]);
    }
    double height = known->height, variance = 0.0;
    if (isfinite(height) && known->is_stated) { /* without lengths, the likeliest height is then the one that was stated */
        for (int k = 0; k < SHAPE_SIZE; ++k) variance += slope[known->lengths][k][1] * slope[known->lengths][k][1];
        height += (height - start[known->lengths][1]) * known->height_deviation * known->height_deviation / variance;
    }
    for (int k = 0; k < SHAPE_SIZE; ++k) coefficient[k] = 0.0;
    for (int step = 0; step < SHAPE_STEPS; ++step) {
        double gradient[SHAPE_SIZE], largest = 0.0;
        for (int i = 0; i < SHAPE_SIZE; ++i) {
            gradient[i] = coefficient[i];
            for (int j = 0; j <= i; ++j) factor->row[i][j] = i == j ? 1.0 : 0.0;
        }
        for (int m = 0; m < count; ++m) {
            bool is_height = m == known->lengths;
            double value = is_height ? height : known->length[m].value;
            double deviation = is_height ? known->height_deviation : known->length[m].deviation;
            double vector[3], row[SHAPE_SIZE], far = 0.0;
            for (int c = 0; c < 3; ++c) {
                vector[c] = start[m][c];
                for (int k = 0; k < SHAPE_SIZE; ++k) vector[c] += slope[m][k][c] * coefficient[k];
                far += vector[c] * vector[c];
            }
            far = fmax(sqrt(far), 1e-9);
            for (int k = 0; k < SHAPE_SIZE; ++k) {
                row[k] = 0.0;
                for (int c = 0; c < 3; ++c) row[k] += slope[m][k][c] * vector[c] / far;
                row[k] /= deviation;
            }
            for (int i = 0; i < SHAPE_SIZE; ++i) {
                gradient[i] += row[i] * (far - value) / deviation;
                for (int j = 0; j <= i; ++j) factor->row[i][j] += row[i] * row[j];
            }
        }
        factorize(factor);
        solve_lower(factor, gradient);
        solve_upper(factor, gradient);
        for (int k = 0; k < SHAPE_SIZE; ++k) {
            coefficient[k] -= gradient[k];
            largest = fmax(largest, fabs(gradient[k]));
        }
        if (!(largest > 1e-9)) break;
    }
}

void likeliest_body(const bs_model *model, const measurements *known, double rest_offset[BS_POINTS][3],
                    double deviation[BS_POINTS]) {
    const double *mean = model_shape_mean(model), *component = model_shape_components(model);
    measurements smaller = *known;
    double scale = 1.0, coefficient[SHAPE_SIZE];
    triangle factor;
    if (isfinite(known->height)) {
        scale = known->height / fmin(fmax(known->height, ADULT_SHORTEST), ADULT_TALLEST);
        smaller.height /= scale;
        smaller.height_deviation /= scale;
        for (int m = 0; m < known->lengths; ++m) {
            smaller.length[m].value /= scale;
            smaller.length[m].deviation /= scale;
        }
    }
    fit(model, &smaller, coefficient, &factor);
    for (int p = 0; p < BS_POINTS; ++p) {
        double far = 0.0, slope[SHAPE_SIZE], square = 0.0;
        for (int c = 0; c < 3; ++c) {
            double value = mean[3 * p + c];
            for (int k = 0; k < SHAPE_SIZE; ++k) value += coefficient[k] * component[(k * BS_POINTS + p) * 3 + c];
            rest_offset[p][c] = scale * value;
            far += value * value;
        }
        far = fmax(sqrt(far), 1e-9);
        for (int k = 0; k < SHAPE_SIZE; ++k) {
            slope[k] = 0.0;
            for (int c = 0; c < 3; ++c)
                slope[k] += component[(k * BS_POINTS + p) * 3 + c] * rest_offset[p][c] / (scale * far);
        }
        solve_lower(&factor, slope);
        for (int k = 0; k < SHAPE_SIZE; ++k) square += slope[k] * slope[k];
        deviation[p] = p == PELVIS ? 0.0 : scale * sqrt(square);
    }
}

double rest_height(double rest_offset[BS_POINTS][3], int point) {
    double place[3];
    place_of(&rest_offset[0][0], point, place);
    return place[1] + rest_offset[PELVIS][1];
}
