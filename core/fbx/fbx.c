/* FBX files for Python: nodes, skins, animation stacks, and local transforms baked at a constant rate.
 *
 * A file is read from memory, without meshes, textures and other files. Memory, depth and the number of nodes are
 * limited, because a file of a few megabytes can unpack to gigabytes.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../vendor/ufbx/ufbx.h"

#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

#define MEMORY_LIMIT ((size_t)1 << 30)   /* bytes, of the scene and again while it is read */
#define DEPTH_LIMIT 400                  /* nodes above a node */
#define TRANSFORM 10                     /* translation (3), rotation wxyz (4), scale (3) */
#define BIND 12                          /* 3 × 4 matrix, a row after the other */

/* Kinds of names that `bs_fbx_name` returns. */
enum { NODE = 0, STACK = 1, SKIN = 2 };

/* How a node takes part in a skeleton; flags of `bs_fbx_nodes`. */
enum { IS_BONE = 1, IS_EMPTY = 2, IS_SKINNED = 4, HAS_BIND = 8 };

typedef struct {
    double unit;     /* m */
    double rate;     /* Hz */
    int32_t axes[3]; /* right, up, front: 0 x, 1 -x, 2 y, 3 -y, 4 z, 5 -z, 6 unknown */
    uint32_t nodes, stacks, skins;
} bs_fbx_about;

/* Read a file. Returns NULL and a message of at most `size` bytes if it cannot be read. */
API void *bs_fbx_open(const void *data, size_t bytes, char *message, size_t size)
{
    ufbx_load_opts options = {0};
    ufbx_error error;
    ufbx_scene *scene;
    options.temp_allocator.memory_limit = MEMORY_LIMIT;
    options.result_allocator.memory_limit = MEMORY_LIMIT;
    options.node_depth_limit = DEPTH_LIMIT;
    options.ignore_geometry = true;
    options.ignore_embedded = true;
    options.skip_skin_vertices = true;
    options.skip_mesh_parts = true;
    options.file_format = UFBX_FILE_FORMAT_FBX;
    options.inherit_mode_handling = UFBX_INHERIT_MODE_HANDLING_COMPENSATE;
    scene = ufbx_load_memory(data, bytes, &options, &error);
    if (!scene && size) {
        snprintf(message, size, "%s%s%.*s", error.description.data, error.info_length ? ": " : "",
                 (int)error.info_length, error.info);
    }
    return scene;
}

API void bs_fbx_close(void *file)
{
    ufbx_free_scene(file);
}

API void bs_fbx_describe(const void *file, bs_fbx_about *about)
{
    const ufbx_scene *scene = file;
    const ufbx_coordinate_axes axes = scene->settings.axes;
    about->unit = scene->settings.unit_meters;
    about->rate = scene->settings.frames_per_second;
    about->axes[0] = (int32_t)axes.right;
    about->axes[1] = (int32_t)axes.up;
    about->axes[2] = (int32_t)axes.front;
    about->nodes = (uint32_t)scene->nodes.count;
    about->stacks = (uint32_t)scene->anim_stacks.count;
    about->skins = (uint32_t)scene->skin_deformers.count;
}

/* Return a name in UTF-8; that of a skin is its mesh's. Empty beyond the last one. */
API const char *bs_fbx_name(const void *file, int kind, uint32_t index)
{
    const ufbx_scene *scene = file;
    if (kind == NODE && index < scene->nodes.count) return scene->nodes.data[index]->name.data;
    if (kind == STACK && index < scene->anim_stacks.count) return scene->anim_stacks.data[index]->name.data;
    if (kind == SKIN && index < scene->skin_deformers.count) {
        for (size_t k = 0; k < scene->meshes.count; k++) {
            const ufbx_mesh *mesh = scene->meshes.data[k];
            for (size_t d = 0; d < mesh->skin_deformers.count; d++) {
                if (mesh->skin_deformers.data[d]->typed_id == index && mesh->instances.count) {
                    return mesh->instances.data[0]->name.data;
                }
            }
        }
        return scene->skin_deformers.data[index]->name.data;
    }
    return "";
}

static void write_transform(double *out, const ufbx_transform *from)
{
    out[0] = from->translation.x, out[1] = from->translation.y, out[2] = from->translation.z;
    out[3] = from->rotation.w, out[4] = from->rotation.x, out[5] = from->rotation.y, out[6] = from->rotation.z;
    out[7] = from->scale.x, out[8] = from->scale.y, out[9] = from->scale.z;
}

static void write_matrix(double *out, const ufbx_matrix *from)
{
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 4; column++) out[4 * row + column] = from->cols[column].v[row];
    }
}

/* Write for each node its parent (-1: none), flags, resting transform and world matrix in the bind pose. */
API void bs_fbx_nodes(const void *file, int32_t *parent, uint8_t *flags, double *rest, double *bind)
{
    const ufbx_scene *scene = file;
    memset(bind, 0, scene->nodes.count * BIND * sizeof *bind);
    for (size_t k = 0; k < scene->nodes.count; k++) {
        const ufbx_node *node = scene->nodes.data[k];
        parent[k] = node->parent ? (int32_t)node->parent->typed_id : -1;
        flags[k] = node->bone                                      ? IS_BONE
                   : node->attrib_type == UFBX_ELEMENT_EMPTY || !node->attrib ? IS_EMPTY
                                                                   : 0;
        write_transform(rest + TRANSFORM * k, &node->local_transform);
    }
    for (size_t s = 0; s < scene->skin_clusters.count; s++) {
        const ufbx_skin_cluster *cluster = scene->skin_clusters.data[s];
        if (!cluster->bone_node) continue;
        flags[cluster->bone_node->typed_id] |= IS_SKINNED | HAS_BIND;
        write_matrix(bind + BIND * cluster->bone_node->typed_id, &cluster->bind_to_world);
    }
    for (size_t p = 0; p < scene->poses.count; p++) {
        const ufbx_pose *pose = scene->poses.data[p];
        for (size_t b = 0; pose->is_bind_pose && b < pose->bone_poses.count; b++) {
            const ufbx_bone_pose *bone = &pose->bone_poses.data[b];
            if (!bone->bone_node || flags[bone->bone_node->typed_id] & HAS_BIND) continue;
            flags[bone->bone_node->typed_id] |= HAS_BIND;
            write_matrix(bind + BIND * bone->bone_node->typed_id, &bone->bone_to_world);
        }
    }
}

/* Mark the nodes that carry a skin. */
API void bs_fbx_skin(const void *file, uint32_t skin, uint8_t *is_carried)
{
    const ufbx_scene *scene = file;
    if (skin >= scene->skin_deformers.count) return;
    const ufbx_skin_deformer *deformer = scene->skin_deformers.data[skin];
    for (size_t c = 0; c < deformer->clusters.count; c++) {
        const ufbx_node *bone = deformer->clusters.data[c]->bone_node;
        if (bone) is_carried[bone->typed_id] = 1;
    }
}

/* Mark the nodes that a stack moves, and write its first and last time in seconds.
 * The times of the keys are taken if the stack has none. */
API void bs_fbx_stack(const void *file, uint32_t stack, uint8_t *is_moved, double *range)
{
    const ufbx_scene *scene = file;
    double first = INFINITY, last = -INFINITY;
    range[0] = range[1] = 0.0;
    if (stack >= scene->anim_stacks.count) return;
    const ufbx_anim_stack *of = scene->anim_stacks.data[stack];
    for (size_t l = 0; l < of->layers.count; l++) {
        const ufbx_anim_layer *layer = of->layers.data[l];
        for (size_t p = 0; p < layer->anim_props.count; p++) {
            const ufbx_anim_prop *property = &layer->anim_props.data[p];
            if (property->element->type != UFBX_ELEMENT_NODE) continue;
            is_moved[property->element->typed_id] = 1;
            for (int c = 0; c < 3; c++) {
                const ufbx_anim_curve *curve = property->anim_value->curves[c];
                if (!curve || !curve->keyframes.count) continue;
                first = fmin(first, curve->min_time);
                last = fmax(last, curve->max_time);
            }
        }
    }
    if (of->time_end > of->time_begin) {
        range[0] = of->time_begin, range[1] = of->time_end;
    } else if (last >= first) {
        range[0] = first, range[1] = last;
    }
}

/* Write the local transforms (frames, count, 10) of some nodes at `begin` + k · `step` seconds. */
API void bs_fbx_bake(const void *file, uint32_t stack, const int32_t *nodes, size_t count, double begin, double step,
                     size_t frames, double *out)
{
    const ufbx_scene *scene = file;
    const ufbx_anim *anim = stack < scene->anim_stacks.count ? scene->anim_stacks.data[stack]->anim : scene->anim;
    for (size_t frame = 0; frame < frames; frame++) {
        const double time = begin + step * (double)frame;
        for (size_t k = 0; k < count; k++, out += TRANSFORM) {
            const ufbx_transform found = ufbx_evaluate_transform(anim, scene->nodes.data[nodes[k]], time);
            write_transform(out, &found);
        }
    }
}
