/* Models: read a file of weights (safetensors: eight bytes of length, a JSON header, numbers) and lay its tables out
 * as the products read them. */
#include "model.h"

#include <string.h>

#include "network.h"

#define FORMAT "bodysense-completion-"
#define VERSION 2
#define ALIGNMENT 64
#define MOST_HIDDEN 4096

/* ---- the header: a minimal JSON reader. Positions are NULL where the text is not what it should be. -------------- */

typedef struct text {
    const char *at, *end;
} text;

static const char *after_spaces(text t) {
    while (t.at && t.at < t.end && (*t.at == ' ' || *t.at == '\n' || *t.at == '\t' || *t.at == '\r')) t.at++;
    return t.at && t.at < t.end ? t.at : NULL;
}

static const char *after_mark(text t, char mark) {
    const char *at = after_spaces(t);
    return at && *at == mark ? at + 1 : NULL;
}

/* After the text that begins here; `inside` is what its quotation marks enclose. */
static const char *after_string(text t, text *inside) {
    const char *at = after_mark(t, '"');
    if (!at) return NULL;
    inside->at = at;
    for (; at < t.end && *at != '"'; at++) {
        if (*at == '\\' && ++at == t.end) return NULL;
    }
    inside->end = at;
    return at < t.end ? at + 1 : NULL;
}

/* After any value that begins here. */
static const char *after_value(text t) {
    int depth = 0;
    text inside;
    do {
        t.at = after_spaces(t);
        if (!t.at) return NULL;
        if (*t.at == '"') {
            t.at = after_string(t, &inside);
            continue;
        }
        depth += *t.at == '{' || *t.at == '[';
        depth -= *t.at == '}' || *t.at == ']';
        if (depth < 0) return NULL;
        const bool number = *t.at == '-' || (*t.at >= '0' && *t.at <= '9');
        t.at++;
        while (number && t.at < t.end && ((*t.at >= '0' && *t.at <= '9') || *t.at == '.' || *t.at == 'e')) t.at++;
    } while (t.at && depth > 0);
    return t.at;
}

static bool same(text t, const char *word) {
    const size_t size = strlen(word);
    return t.at && (size_t)(t.end - t.at) == size && memcmp(t.at, word, size) == 0;
}

/* The value of a member of the object that begins here. False if the text is damaged; value->at is NULL if the object
 * has no such member. */
static bool member(text object, const char *name, text *value) {
    text key, t = {after_mark(object, '{'), object.end};
    *value = (text){NULL, object.end};
    if (!t.at) return false;
    if (after_mark(t, '}')) return true;
    for (;;) {
        t.at = after_string(t, &key);
        t.at = after_mark(t, ':');
        if (!t.at) return false;
        if (same(key, name)) value->at = after_spaces(t);
        t.at = after_value(t);
        if (!t.at) return false;
        if (after_mark(t, '}')) return true;
        t.at = after_mark(t, ',');
    }
}

/* Up to `most` whole numbers of a list; -1 if it is not such a list, or longer. */
static int whole_numbers(text t, uint64_t *numbers, int most) {
    int count = 0;
    t.at = after_mark(t, '[');
    if (after_mark(t, ']')) return 0;
    for (;;) {
        t.at = after_spaces(t);
        if (!t.at || *t.at < '0' || *t.at > '9' || count == most) return -1;
        uint64_t number = 0;
        for (; t.at < t.end && *t.at >= '0' && *t.at <= '9'; t.at++) {
            if (number > UINT64_MAX / 20) return -1;
            number = number * 10 + (uint64_t)(*t.at - '0');
        }
        numbers[count++] = number;
        if (after_mark(t, ']')) return count;
        t.at = after_mark(t, ',');
    }
}

/* ---- tensors ----------------------------------------------------------------------------------------------------- */

/* A file, and where its tables go: only counted if `memory` is NULL. The first thing wrong is kept in `wrong`. */
typedef struct reader {
    text header;
    const uint8_t *data;
    size_t data_size;
    uint8_t *memory;
    size_t used;
    bs_result wrong;
    kernel kernel;
    int rank; /* of all updates; 0 before the first one */
} reader;

typedef struct tensor {
    const uint8_t *at; /* NULL if missing */
    int type;          /* bytes of a number: 1 int8, 2 half precision, 4 float, 8 double */
    int rows, columns; /* columns: the product of all lengths but the first */
} tensor;

static void *take(reader *r, size_t bytes) {
    void *at = r->memory ? r->memory + r->used : NULL;
    r->used += (bytes + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    return at;
}

static tensor find(reader *r, const char *name) {
    const tensor none = {NULL, 0, 0, 0};
    uint64_t length[4], range[2];
    text entry, type, shape, offsets, kind;
    if (r->wrong) return none;
    r->wrong = BS_MODEL_DAMAGED;
    if (!member(r->header, name, &entry)) return none;
    if (!entry.at) {
        r->wrong = BS_MODEL_INCOMPLETE;
        return none;
    }
    if (!member(entry, "dtype", &type) || !member(entry, "shape", &shape) || !member(entry, "data_offsets", &offsets))
        return none;
    const int lengths = whole_numbers(shape, length, 4);
    if (!after_string(type, &kind) || lengths < 1 || whole_numbers(offsets, range, 2) != 2) return none;
    uint64_t columns = 1;
    for (int k = 0; k < lengths; k++) {
        if (length[k] < 1 || length[k] > 4 * MOST_HIDDEN) return none;
        columns *= k ? length[k] : 1;
    }
    const int size = same(kind, "I8") ? 1 : same(kind, "F16") ? 2 : same(kind, "F32") ? 4 : same(kind, "F64") ? 8 : 0;
    if (columns > 4 * MOST_HIDDEN || range[1] > r->data_size || range[0] > range[1]) return none;
    if (range[1] - range[0] != length[0] * columns * (uint64_t)size) return none;
    r->wrong = BS_OK;
    return (tensor){r->data + range[0], size, (int)length[0], (int)columns};
}

static tensor expect(reader *r, const char *name, int rows, int columns) {
    const tensor found = find(r, name);
    if (!r->wrong && (found.rows != rows || found.columns != columns)) r->wrong = BS_MODEL_INCOMPLETE;
    return found;
}

static float half(uint16_t bits) {
    const uint32_t sign = (uint32_t)(bits & 0x8000U) << 16, size = bits & 0x7FFFU;
    float value;
    /* Its exponent counts from 15, that of a float from 127. */
    const uint32_t shifted = size << 13, scale = 0x77800000U; /* 2^112 */
    float factor;
    memcpy(&value, &shifted, sizeof value);
    memcpy(&factor, &scale, sizeof factor);
    value *= factor;
    return sign ? -value : value;
}

/* A number of a tensor of floats. */
static float number(tensor t, size_t place) {
    float value;
    uint16_t bits;
    if (t.type == 1) return (float)(int8_t)t.at[place];
    if (t.type == 2) {
        memcpy(&bits, t.at + 2 * place, sizeof bits);
        return half(bits);
    }
    if (t.type == 8) {
        double wide;
        memcpy(&wide, t.at + 8 * place, sizeof wide);
        return (float)wide;
    }
    memcpy(&value, t.at + 4 * place, sizeof value);
    return value;
}

/* Room for a name with something behind it. */
typedef struct name {
    char text[80];
} name;

static name joined(const char *a, const char *b) {
    name both = {{0}};
    const size_t size = strlen(a);
    memcpy(both.text, a, size);
    memcpy(both.text + size, b, strlen(b));
    return both;
}

/* Floats, followed by zeros up to a whole group. */
static const float *load_floats(reader *r, const char *name, int rows, int columns) {
    const tensor t = expect(r, name, rows, columns);
    const int count = rows * columns;
    float *to = take(r, (size_t)grouped(count) * sizeof *to);
    if (r->wrong || !to) return NULL;
    memset(to, 0, (size_t)grouped(count) * sizeof *to);
    for (int k = 0; k < count; k++) to[k] = number(t, (size_t)k);
    return to;
}

static const double *load_doubles(reader *r, const char *name, int rows, int columns) {
    const tensor t = expect(r, name, rows, columns);
    const size_t size = (size_t)rows * (size_t)columns * sizeof(double);
    double *to = take(r, size);
    if (!r->wrong && t.type != 8) r->wrong = BS_MODEL_INCOMPLETE;
    return r->wrong || !to ? NULL : memcpy(to, t.at, size);
}

/* The columns `first` … of a table in bytes, for inputs of up to `steps`. */
static matrix load_matrix(reader *r, const char *name, int rows, int columns, int first, int inputs, int steps) {
    const int bundle = bundle_of(&r->kernel, steps);
    const tensor t = expect(r, name, rows, columns);
    const size_t size = (size_t)grouped(rows) * (size_t)padded(inputs, bundle);
    const size_t sums = bundle == QUADS ? (size_t)grouped(rows) * (size_t)blocks_of(inputs) * sizeof(int32_t) : 0;
    if (!r->wrong && t.type != 1) r->wrong = BS_MODEL_INCOMPLETE;
    matrix m = {.rows = rows, .inputs = inputs, .bundle = bundle};
    m.step = load_floats(r, joined(name, ".step").text, rows, 1);
    int8_t *to = take(r, size);
    int32_t *unbiased = take(r, sums);
    m.weight = to;
    m.unbiased = unbiased;
    if (r->wrong || !to) return m;
    memset(to, 0, size);
    memset(unbiased, 0, sums);
    for (int row = 0; row < rows; row++) {
        int8_t *group = to + (size_t)(row / GROUP) * GROUP * (size_t)padded(inputs, bundle);
        for (int k = 0; k < inputs; k++) {
            const int8_t weight = (int8_t)t.at[(size_t)row * (size_t)columns + (size_t)(first + k)];
            group[(k / bundle * GROUP + row % GROUP) * bundle + k % bundle] = weight;
            if (bundle == QUADS)
                unbiased[(row / GROUP * blocks_of(inputs) + k / BLOCK) * GROUP + row % GROUP] -= 128 * weight;
        }
    }
    return m;
}

/* A table of floats, of half precision, or of bytes that count in a step of each row. */
static table load_table(reader *r, const char *name, int rows, int inputs) {
    const tensor t = expect(r, name, rows, inputs);
    const float *step = !r->wrong && t.type == 1 ? load_floats(r, joined(name, ".step").text, rows, 1) : NULL;
    table out = {NULL, rows, inputs};
    float *to = take(r, (size_t)grouped(rows) * (size_t)inputs * sizeof *to);
    out.weight = to;
    if (r->wrong || !to) return out;
    memset(to, 0, (size_t)grouped(rows) * (size_t)inputs * sizeof *to);
    for (int row = 0; row < rows; row++) {
        for (int k = 0; k < inputs; k++)
            to[(row / GROUP * inputs + k) * GROUP + row % GROUP] =
                number(t, (size_t)row * (size_t)inputs + (size_t)k) * (step ? step[row] : 1.0F);
    }
    return out;
}

static bool has(const reader *r, const char *name) {
    text entry;
    return member(r->header, name, &entry) && entry.at;
}

/* The update of a product with `rows` rows, from columns `first` … of its `columns`; none if the file has none. */
static update load_update(reader *r, const char *network, const char *product, int rows, int columns, int first,
                          int inputs, int steps) {
    const name base = joined(joined(network, ".updates.").text, product), inward = joined(base.text, ".0.weight");
    update out = {.inward = {.rows = 0}};
    if (!has(r, inward.text)) return out;
    const int rank = find(r, inward.text).rows;
    if (!r->rank) r->rank = rank;
    if (!r->wrong && (rank % GROUP || rank != r->rank)) r->wrong = BS_MODEL_INCOMPLETE;
    out.inward = load_matrix(r, inward.text, rank, columns, first, inputs, steps);
    out.outward = load_matrix(r, joined(base.text, ".1.weight").text, rows, rank, 0, rank, FEATURE_STEPS);
    return out;
}

/* `steps`: of its inputs. */
static recurrent load_recurrent(reader *r, const char *network, int layer, int inputs, int hidden, int steps) {
    const char place[] = {(char)('0' + layer), 0};
    recurrent out;
    out.of_input = load_matrix(r, joined(joined(network, ".recurrent.weight_ih_l").text, place).text, 3 * hidden,
                               inputs, 0, inputs, steps);
    out.of_state = load_matrix(r, joined(joined(network, ".recurrent.weight_hh_l").text, place).text, 3 * hidden,
                               hidden, 0, hidden, STATE_STEPS);
    out.input_update = load_update(r, network, joined("input_l", place).text, 3 * hidden, inputs, 0, inputs, steps);
    out.state_update = load_update(r, network, joined("state_l", place).text, 3 * hidden, hidden, 0, hidden,
                                   STATE_STEPS);
    out.input_bias = load_floats(r, joined(joined(network, ".recurrent.bias_ih_l").text, place).text, 3 * hidden, 1);
    out.state_bias = load_floats(r, joined(joined(network, ".recurrent.bias_hh_l").text, place).text, 3 * hidden, 1);
    return out;
}

static branch load_branch(reader *r, const char *network, const char *kind, int hidden, int features, int outputs) {
    const name base = joined(joined(network, ".").text, kind), weight = joined(base.text, ".0.weight");
    const int both = hidden + features;
    const int width = find(r, weight.text).rows;
    branch out;
    out.of_hidden = load_matrix(r, weight.text, width, both, 0, hidden, STATE_STEPS);
    out.of_features = load_matrix(r, weight.text, width, both, hidden, features, FEATURE_STEPS);
    out.hidden_update = load_update(r, network, kind, width, both, 0, hidden, STATE_STEPS);
    out.features_update = load_update(r, network, kind, width, both, hidden, features, FEATURE_STEPS);
    out.bias = load_floats(r, joined(base.text, ".0.bias").text, width, 1);
    out.out = load_table(r, joined(base.text, ".2.weight").text, outputs, width);
    out.out_bias = load_floats(r, joined(base.text, ".2.bias").text, outputs, 1);
    return out;
}

/* ---- files ------------------------------------------------------------------------------------------------------- */

static reader opened(const void *file, size_t bytes, kernel kernel) {
    reader r = {.wrong = BS_MODEL_DAMAGED, .kernel = kernel};
    uint64_t size;
    text value;
    if (!file || bytes < sizeof size) return r;
    memcpy(&size, file, sizeof size);
    if (size > bytes - sizeof size) return r;
    r.header = (text){(const char *)file + sizeof size, (const char *)file + sizeof size + size};
    r.data = (const uint8_t *)file + sizeof size + size;
    r.data_size = bytes - sizeof size - (size_t)size;
    if (!member(r.header, "__metadata__", &value)) return r;
    r.wrong = BS_MODEL_FOREIGN;
    if (!value.at || !member(value, "format", &value) || !value.at || !after_string(value, &value)) return r;
    const size_t prefix = strlen(FORMAT);
    if ((size_t)(value.end - value.at) <= prefix || memcmp(value.at, FORMAT, prefix) != 0) return r;
    int version = 0;
    for (const char *at = value.at + prefix; at < value.end; at++) {
        if (*at < '0' || *at > '9' || version > 1000000) return r;
        version = version * 10 + (*at - '0');
    }
    r.wrong = version == VERSION ? BS_OK : version > VERSION ? BS_MODEL_NEWER : BS_MODEL_FOREIGN;
    return r;
}

/* Whether the model card has a member that is true. */
static bool says(text header, const char *name) {
    text card, value, word;
    return member(header, "__metadata__", &card) && card.at && member(card, name, &value) && value.at &&
           after_string(value, &word) && same(word, "true");
}

static bs_model loaded(reader *r) {
    bs_model m;
    memset(&m, 0, sizeof m);
    take(r, sizeof m);
    m.kernel = r->kernel;
    m.features = find(r, "body.recurrent.weight_ih_l0").columns;
    m.hidden = find(r, "body.recurrent.weight_hh_l0").columns;
    m.hand_hidden = find(r, "fingers.recurrent.weight_hh_l0").columns;
    m.hand_features = HAND_FEATURES;
    m.reads_unplaced_head = says(r->header, "reads_unplaced_head");
    if (r->wrong) return m;
    /* A network that reads more than this library knows of. */
    if (m.features > FEATURES && m.features != FEATURES_ACCELERATION) r->wrong = BS_MODEL_NEWER;
    for (m.layers = 0; m.layers < MOST_LAYERS && !r->wrong; m.layers++) {
        const char name[] = {"body.recurrent.weight_ih_l0"};
        struct name numbered = joined(name, "");
        numbered.text[sizeof name - 2] = (char)('0' + m.layers);
        if (!has(r, numbered.text)) break;
        m.layer[m.layers] = load_recurrent(r, "body", m.layers, m.layers ? m.hidden : m.features, m.hidden,
                                           m.layers ? STATE_STEPS : FEATURE_STEPS);
    }
    if (!r->wrong && m.features != FEATURES && m.features != FEATURES_ACCELERATION) r->wrong = BS_MODEL_INCOMPLETE;
    m.turn = load_branch(r, "body", "turn_branch", m.hidden, m.features, TURNED);
    m.judge = load_branch(r, "body", "judge_branch", m.hidden, m.features, JUDGED);
    m.rank = r->rank;
    m.hands = load_recurrent(r, "fingers", 0, HAND_FEATURES, m.hand_hidden, FEATURE_STEPS);
    m.fingers = load_branch(r, "fingers", "branch", m.hand_hidden, HAND_FEATURES, HAND_OUTPUTS);
    m.usual_bones = load_floats(r, "body.usual_bones", BODY_POINTS, 3);
    m.standing = load_floats(r, "body.standing", BODY_JOINTS, 6);
    m.usual_fingers = load_floats(r, "fingers.usual_bones", HAND_POINTS, 3);
    m.relaxed = load_floats(r, "fingers.relaxed", HAND_JOINTS, 6);
    m.shape_mean = load_doubles(r, "shape.mean", BS_POINTS, 3);
    m.shape_components = load_doubles(r, "shape.components", SHAPE_SIZE, 3 * BS_POINTS);
    m.error_inward = load_table(r, "errors.inward.weight", ERROR_HIDDEN, ERROR_KNOWN);
    m.error_inward_offset = load_floats(r, "errors.inward.bias", ERROR_HIDDEN, 1);
    m.error_weight = load_table(r, "errors.weight", 2 * BODY_POINTS, ERROR_KNOWN + ERROR_HIDDEN);
    m.error_offset = load_floats(r, "errors.bias", 2 * BODY_POINTS, 1);
    return m;
}

static size_t size_of(const void *file, size_t bytes, kernel kernel) {
    reader r = opened(file, bytes, kernel);
    loaded(&r);
    return r.wrong ? 0 : r.used;
}

size_t bs_model_size(const void *file, size_t bytes) { return size_of(file, bytes, fastest_kernel()); }

bs_result model_open(const void *file, size_t bytes, kernel kernel, void *memory, size_t size,
                     const bs_model **model) {
    reader r = opened(file, bytes, kernel);
    *model = NULL;
    loaded(&r);
    if (r.wrong) return r.wrong;
    if (!memory || size < r.used || (uintptr_t)memory % ALIGNMENT) return BS_MEMORY_SMALL;
    r.memory = memory;
    r.used = 0;
    bs_model m = loaded(&r);
    m.fingerprint = 0xCBF29CE484222325U; /* FNV-1a of eight bytes at a time */
    for (size_t at = 0; at < bytes; at += 8) {
        uint64_t word = 0;
        memcpy(&word, (const uint8_t *)file + at, bytes - at < 8 ? bytes - at : 8);
        m.fingerprint = (m.fingerprint ^ word) * 0x100000001B3U;
    }
    memcpy(memory, &m, sizeof m);
    *model = memory;
    return BS_OK;
}

bs_result bs_model_open(const void *file, size_t bytes, void *memory, size_t size, const bs_model **model) {
    return model_open(file, bytes, fastest_kernel(), memory, size, model);
}

const char *bs_model_kernel(const bs_model *model) { return model->kernel.name; }

uint64_t model_fingerprint(const bs_model *model) { return model->fingerprint; }
