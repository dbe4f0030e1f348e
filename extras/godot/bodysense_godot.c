/* The node BodysenseBody for Godot 4.2 and later, over Godot's C interface for extensions. From GDScript:
 *
 *     var body := BodysenseBody.new()
 *     body.start(FileAccess.get_file_as_bytes("res://addons/bodysense/completion.safetensors"), 1.75)  # m; 0: inferred
 *     body.step(seconds, {"head": $XRCamera3D.transform, "left_wrist": $LeftHand.transform})
 *     skeleton.set_bone_pose_rotation(bone, body.rotation_of("left_elbow"))
 *
 * Godot's axes are those of bodysense: right-handed, +Y up, metres. A skeleton faces +Z. For Godot of single precision.
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "bodysense.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* ---- the part of Godot's interface that is used: names and layouts of its documentation ---------------------------- */

enum { NIL = 0, BOOL = 1, INT = 2, FLOAT = 3, STRING = 4, VECTOR3 = 9, QUATERNION = 15, TRANSFORM3D = 18, STRING_NAME = 21,
       DICTIONARY = 27, PACKED_BYTE_ARRAY = 29 };
enum { SCENE = 2, METHOD_NORMAL = 1, USAGE_DEFAULT = 6, CALL_INVALID_ARGUMENT = 2, CALL_TOO_FEW = 4, CALL_TOO_MANY = 3 };

typedef struct { uint64_t bytes[3]; } Variant;
typedef struct { void *bytes[2]; } Opaque; /* a String, StringName, Dictionary or PackedByteArray */
typedef struct { int32_t error, argument, expected; } CallError;
typedef void (*Function)(void);
typedef Function (*GetFunction)(const char *name);
typedef void (*Convert)(void *to, void *from);
typedef void (*Destroy)(void *value);
typedef struct { int32_t type; void *name, *class_name; uint32_t hint; void *hint_string; uint32_t usage; } Property;

typedef struct Method Method;
typedef struct {
    void *name;
    void *userdata;
    void (*call)(void *userdata, void *self, const void *const *arguments, int64_t count, void *result, CallError *error);
    void (*pointer_call)(void *userdata, void *self, const void *const *arguments, void *result);
    uint32_t flags;
    uint8_t has_result;
    Property *result;
    int32_t result_kind;
    uint32_t argument_count;
    Property *arguments;
    int32_t *argument_kinds;
    uint32_t default_count;
    void **defaults;
} MethodInfo;

typedef struct {
    uint8_t is_virtual, is_abstract, is_exposed;
    Function before[11]; /* set, get, properties, … to string, reference, unreference */
    void *(*create)(void *userdata);
    void (*destroy)(void *userdata, void *instance);
    Function recreate;
    void *(*virtual_method)(void *userdata, const void *name);
    Function after[3];
    void *userdata;
} ClassInfo;

typedef struct {
    int32_t level;
    void *userdata;
    void (*initialize)(void *userdata, int32_t level);
    void (*deinitialize)(void *userdata, int32_t level);
} Initialization;

/* Functions of Godot, fetched once when the library is loaded; constant afterwards. */
static struct {
    void *library;
    void (*new_name)(void *to, const char *text, uint8_t is_static);
    void (*new_string)(void *to, const char *text);
    int64_t (*text_of)(const void *string, char *to, int64_t size);
    void (*destroy_variant)(void *variant);
    int32_t (*type_of)(const void *variant);
    void (*call)(void *self, const void *method, const void *const *arguments, int64_t count, void *result, CallError *);
    uint8_t (*first)(const void *self, void *iterator, uint8_t *valid);
    uint8_t (*next)(const void *self, void *iterator, uint8_t *valid);
    void (*key_at)(const void *self, void *iterator, void *key, uint8_t *valid);
    void (*value_at)(const void *self, const void *key, void *value, uint8_t *valid);
    const uint8_t *(*byte_at)(const void *array, int64_t index);
    void *(*construct)(const void *class_name);
    void (*set_instance)(void *object, const void *class_name, void *instance);
    void (*register_class)(void *library, const void *name, const void *parent, const ClassInfo *info);
    void (*register_method)(void *library, const void *class_name, const MethodInfo *info);
    void (*unregister_class)(void *library, const void *name);
    void (*print_error)(const char *text, const char *function, const char *file, int32_t line, uint8_t notify);
    Convert (*from_type)(int32_t type);
    Convert (*to_type)(int32_t type);
    Destroy (*destructor)(int32_t type);
} godot;

/* ---- a body -------------------------------------------------------------------------------------------------------- */

typedef struct {
    void *blocks[3]; /* as allocated: model, state, scratch */
    const bs_model *model;
    bs_state *state;
    void *scratch;
    size_t scratch_size;
    double root[3], rotation[BS_JOINTS][4], points[BS_POINTS][3];
} Body;

static void *aligned(Body *body, int block, size_t size) {
    free(body->blocks[block]);
    body->blocks[block] = malloc(size + 64);
    uintptr_t at = (uintptr_t)body->blocks[block];
    return body->blocks[block] ? (void *)((at + 63) / 64 * 64) : NULL;
}

static void release(Body *body) {
    for (int block = 0; block < 3; ++block) free(body->blocks[block]);
    memset(body, 0, sizeof *body);
}

static uint8_t done(bs_result result) {
    if (result != BS_OK) godot.print_error(bs_message(result), "BodysenseBody", "bodysense", 0, 0);
    return result == BS_OK;
}

static uint8_t start(Body *body, const uint8_t *file, size_t bytes, double height) {
    release(body);
    size_t size = bs_model_size(file, bytes);
    if (!size) return done(BS_MODEL_DAMAGED);
    void *memory = aligned(body, 0, size);
    bs_result result = memory ? bs_model_open(file, bytes, memory, size, &body->model) : BS_MEMORY_SMALL;
    if (result != BS_OK) return done(result);
    bs_person *person = calloc(1, sizeof *person);
    size = bs_state_size(body->model);
    body->scratch_size = bs_scratch_size(body->model, 1);
    memory = aligned(body, 1, size);
    body->scratch = aligned(body, 2, body->scratch_size);
    result = person && memory && body->scratch ? BS_OK : BS_MEMORY_SMALL;
    if (result == BS_OK) {
        person->height = height > 0 ? height : NAN;
        person->height_deviation = 0.025;
        result = bs_person_likeliest(body->model, person);
    }
    if (result == BS_OK) result = bs_state_start(body->model, person, memory, size, &body->state);
    free(person);
    return done(result);
}

static int point_of(const void *string) {
    char name[64] = "";
    int64_t length = godot.text_of(string, name, sizeof name - 1);
    if (length >= (int64_t)sizeof name) return -1;
    for (int point = 0; point < BS_POINTS; ++point)
        if (strcmp(bs_point_name(point), name) == 0) return point;
    return -1;
}

/* A rotation from the rows of a basis, whose columns may be scaled. */
static void rotation_of_basis(const float rows[9], double q[4]) {
    double m[3][3], trace = 0;
    for (int c = 0; c < 3; ++c) {
        double length = sqrt((double)rows[c] * rows[c] + (double)rows[3 + c] * rows[3 + c] + (double)rows[6 + c] * rows[6 + c]);
        for (int r = 0; r < 3; ++r) m[r][c] = rows[3 * r + c] / (length > 0 ? length : 1);
        trace += m[c][c];
    }
    int k = trace > 0 ? 0 : m[0][0] >= m[1][1] && m[0][0] >= m[2][2] ? 1 : m[1][1] >= m[2][2] ? 2 : 3;
    if (k == 0) {
        q[0] = 1 + trace, q[1] = m[2][1] - m[1][2], q[2] = m[0][2] - m[2][0], q[3] = m[1][0] - m[0][1];
    } else {
        int i = k - 1, j = (i + 1) % 3, l = (i + 2) % 3;
        q[0] = m[l][j] - m[j][l], q[1 + i] = 1 + m[i][i] - m[j][j] - m[l][l];
        q[1 + j] = m[j][i] + m[i][j], q[1 + l] = m[l][i] + m[i][l];
    }
    double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4; ++i) q[i] /= length;
}

static uint8_t step(Body *body, double time, const Variant *tracked) {
    if (!body->state) return done(BS_STATE_FOREIGN);
    int32_t point[BS_POINTS], count = 0;
    double position[BS_POINTS][3], rotation[BS_POINTS][4], accuracy[BS_POINTS];
    uint8_t has[BS_POINTS], valid = 1;
    Variant at;
    bs_result result = BS_OK;
    for (uint8_t more = godot.first(tracked, &at, &valid); valid && more && result == BS_OK;
         more = godot.next(tracked, &at, &valid)) {
        Variant key, value;
        Opaque name;
        float place[12];
        godot.key_at(tracked, &at, &key, &valid);
        godot.value_at(tracked, &key, &value, &valid);
        int32_t kind = godot.type_of(&key);
        if ((kind != STRING && kind != STRING_NAME) || godot.type_of(&value) != TRANSFORM3D || count == BS_POINTS) {
            result = BS_POINT_UNKNOWN;
        } else {
            godot.to_type(STRING)(&name, &key);
            point[count] = point_of(&name);
            godot.destructor(STRING)(&name);
            godot.to_type(TRANSFORM3D)(place, &value);
            rotation_of_basis(place, rotation[count]);
            for (int i = 0; i < 3; ++i) position[count][i] = place[9 + i];
            accuracy[count] = 0.001;
            has[count] = 1;
            if (point[count] < 0) result = BS_POINT_UNKNOWN;
            ++count;
        }
        godot.destroy_variant(&key);
        godot.destroy_variant(&value);
    }
    godot.destroy_variant(&at);
    if (result != BS_OK) return done(result);
    bs_observation seen = {.frames = 1, .points = count, .point = point, .time = &time, .position = position[0],
                           .rotation = rotation[0], .has_position = has, .has_rotation = has, .accuracy = accuracy};
    bs_estimate made = {.root_position = body->root, .rotation = body->rotation[0], .points = body->points[0]};
    bs_settings settings = bs_default_settings();
    int refused = 0;
    return done(bs_step(body->model, &settings, 1, &seen, &body->state, &made, body->scratch, body->scratch_size, &refused));
}

/* ---- methods ------------------------------------------------------------------------------------------------------- */

/* Each takes pointers to typed values, and writes its typed result. */
static void start_method(Body *body, const void *const *arguments, void *result) {
    Variant array, length;
    Opaque size;
    CallError error;
    int64_t bytes = 0;
    godot.from_type(PACKED_BYTE_ARRAY)(&array, (void *)(uintptr_t)arguments[0]);
    godot.new_name(&size, "size", 0);
    godot.call(&array, &size, NULL, 0, &length, &error);
    godot.to_type(INT)(&bytes, &length);
    godot.destructor(STRING_NAME)(&size);
    godot.destroy_variant(&length);
    godot.destroy_variant(&array);
    const uint8_t *file = bytes > 0 ? godot.byte_at(arguments[0], 0) : NULL;
    *(uint8_t *)result = file ? start(body, file, (size_t)bytes, *(const double *)arguments[1]) : done(BS_MODEL_DAMAGED);
}

static void step_method(Body *body, const void *const *arguments, void *result) {
    Variant tracked;
    godot.from_type(DICTIONARY)(&tracked, (void *)(uintptr_t)arguments[1]);
    *(uint8_t *)result = step(body, *(const double *)arguments[0], &tracked);
    godot.destroy_variant(&tracked);
}

static void vector(const double *from, void *result) {
    for (int i = 0; i < 3; ++i) ((float *)result)[i] = (float)from[i];
}

static void root_method(Body *body, const void *const *arguments, void *result) {
    (void)arguments;
    vector(body->root, result);
}

/* Rotation of a joint in its parent's axes; identity in the T-pose. The pelvis' is in the world. */
static void rotation_method(Body *body, const void *const *arguments, void *result) {
    int joint = point_of(arguments[0]);
    double none[4] = {1, 0, 0, 0}, *q = joint < 0 || joint >= BS_JOINTS ? none : body->rotation[joint];
    if (q == none) done(BS_POINT_UNKNOWN);
    for (int i = 0; i < 4; ++i) ((float *)result)[i] = (float)q[(i + 1) % 4];
}

static void point_method(Body *body, const void *const *arguments, void *result) {
    int point = point_of(arguments[0]);
    double none[3] = {0, 0, 0};
    if (point < 0) done(BS_POINT_UNKNOWN);
    vector(point < 0 ? none : body->points[point], result);
}

struct Method {
    const char *name;
    void (*run)(Body *body, const void *const *arguments, void *result);
    int32_t result, count, types[2];
    const char *names[2];
};

static const Method METHODS[] = {
    {"start", start_method, BOOL, 2, {PACKED_BYTE_ARRAY, FLOAT}, {"weights", "height"}},
    {"step", step_method, BOOL, 2, {FLOAT, DICTIONARY}, {"time", "tracked"}},
    {"root_position", root_method, VECTOR3, 0, {NIL, NIL}, {NULL, NULL}},
    {"rotation_of", rotation_method, QUATERNION, 1, {STRING, NIL}, {"joint", NULL}},
    {"point", point_method, VECTOR3, 1, {STRING, NIL}, {"name", NULL}},
};

static void pointer_call(void *method, void *self, const void *const *arguments, void *result) {
    ((const Method *)method)->run(self, arguments, result);
}

static void variant_call(void *userdata, void *self, const void *const *arguments, int64_t count, void *result,
                         CallError *error) {
    const Method *method = userdata;
    if (count != method->count) {
        error->error = count < method->count ? CALL_TOO_FEW : CALL_TOO_MANY;
        error->expected = method->count;
        return;
    }
    union { Opaque opaque; double number; } value[2];
    const void *typed[2] = {&value[0], &value[1]};
    for (int i = 0; i < method->count; ++i) {
        int32_t type = godot.type_of(arguments[i]), wanted = method->types[i];
        /* A number may be an int, and a name a StringName; Godot's conversion takes both. */
        if (type != wanted && !(wanted == FLOAT && type == INT) && !(wanted == STRING && type == STRING_NAME)) {
            *error = (CallError){CALL_INVALID_ARGUMENT, i, wanted};
            return;
        }
    }
    for (int i = 0; i < method->count; ++i) godot.to_type(method->types[i])(&value[i], (void *)(uintptr_t)arguments[i]);
    float made[4];
    method->run(self, typed, made);
    godot.from_type(method->result)(result, made);
    for (int i = 0; i < method->count; ++i)
        if (method->types[i] != FLOAT) godot.destructor(method->types[i])(&value[i]);
}

/* ---- registration -------------------------------------------------------------------------------------------------- */

static void *create(void *userdata) {
    (void)userdata;
    Opaque parent, name;
    godot.new_name(&parent, "Node", 0);
    godot.new_name(&name, "BodysenseBody", 0);
    void *object = godot.construct(&parent);
    godot.set_instance(object, &name, calloc(1, sizeof(Body)));
    godot.destructor(STRING_NAME)(&parent);
    godot.destructor(STRING_NAME)(&name);
    return object;
}

static void destroy(void *userdata, void *instance) {
    (void)userdata;
    if (instance) release(instance);
    free(instance);
}

static void *no_virtual_method(void *userdata, const void *name) {
    (void)userdata, (void)name;
    return NULL;
}

static void register_method(const Method *method, const void *class_name) {
    Opaque name, empty, empty_name, argument_name[2];
    godot.new_name(&name, method->name, 0);
    godot.new_name(&empty_name, "", 0);
    godot.new_string(&empty, "");
    Property result = {method->result, &empty_name, &empty_name, 0, &empty, USAGE_DEFAULT}, arguments[2];
    int32_t kinds[2] = {0, 0};
    for (int i = 0; i < method->count; ++i) {
        godot.new_name(&argument_name[i], method->names[i], 0);
        arguments[i] = (Property){method->types[i], &argument_name[i], &empty_name, 0, &empty, USAGE_DEFAULT};
    }
    MethodInfo info = {.name = &name, .userdata = (void *)(uintptr_t)method, .call = variant_call,
                       .pointer_call = pointer_call, .flags = METHOD_NORMAL, .has_result = 1, .result = &result,
                       .argument_count = (uint32_t)method->count, .arguments = arguments, .argument_kinds = kinds};
    godot.register_method(godot.library, class_name, &info);
    for (int i = 0; i < method->count; ++i) godot.destructor(STRING_NAME)(&argument_name[i]);
    godot.destructor(STRING)(&empty);
    godot.destructor(STRING_NAME)(&empty_name);
    godot.destructor(STRING_NAME)(&name);
}

static void initialize(void *userdata, int32_t level) {
    (void)userdata;
    if (level != SCENE) return;
    Opaque name, parent;
    godot.new_name(&name, "BodysenseBody", 0);
    godot.new_name(&parent, "Node", 0);
    ClassInfo info = {.is_exposed = 1, .create = create, .destroy = destroy, .virtual_method = no_virtual_method};
    godot.register_class(godot.library, &name, &parent, &info);
    for (size_t k = 0; k < sizeof METHODS / sizeof *METHODS; ++k) register_method(&METHODS[k], &name);
    godot.destructor(STRING_NAME)(&parent);
    godot.destructor(STRING_NAME)(&name);
}

static void deinitialize(void *userdata, int32_t level) {
    (void)userdata;
    if (level != SCENE) return;
    Opaque name;
    godot.new_name(&name, "BodysenseBody", 0);
    godot.unregister_class(godot.library, &name);
    godot.destructor(STRING_NAME)(&name);
}

EXPORT uint8_t bodysense_init(GetFunction get, void *library, Initialization *initialization) {
    static const char *const NAMES[] = {
        "string_name_new_with_latin1_chars", "string_new_with_utf8_chars", "string_to_utf8_chars", "variant_destroy",
        "variant_get_type", "variant_call", "variant_iter_init", "variant_iter_next", "variant_iter_get",
        "variant_get_keyed", "packed_byte_array_operator_index_const", "classdb_construct_object", "object_set_instance",
        "classdb_register_extension_class2", "classdb_register_extension_class_method",
        "classdb_unregister_extension_class", "print_error", "get_variant_from_type_constructor",
        "get_variant_to_type_constructor", "variant_get_ptr_destructor"};
    void *const places[] = {&godot.new_name, &godot.new_string, &godot.text_of, &godot.destroy_variant, &godot.type_of,
                            &godot.call, &godot.first, &godot.next, &godot.key_at, &godot.value_at, &godot.byte_at,
                            &godot.construct, &godot.set_instance, &godot.register_class, &godot.register_method,
                            &godot.unregister_class, &godot.print_error, &godot.from_type, &godot.to_type,
                            &godot.destructor};
    for (size_t k = 0; k < sizeof NAMES / sizeof *NAMES; ++k) {
        Function function = get(NAMES[k]);
        if (!function) return 0;
        memcpy(places[k], &function, sizeof function);
    }
    godot.library = library;
    *initialization = (Initialization){SCENE, NULL, initialize, deinitialize};
    return 1;
}
