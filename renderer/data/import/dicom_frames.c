/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/dicom_frames.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/vec.h"

enum { STACKS_MAX = 8 };

/* Frames of one stack can be slices of one volume. */
static bool is_same_stack(const struct dicom_frame *a, const struct dicom_frame *b) {
    if (a->is_placed != b->is_placed || strcmp(a->stack, b->stack) != 0)
        return false;
    for (int axis = 0; axis < 2; axis++) {
        const double cosine =
            sp_vec3_dot(sp_vec3_from(a->along[axis]), sp_vec3_from(b->along[axis]));
        if ((a->is_placed && !(cosine > 0.9999)) ||
            fabs(a->spacing[axis] - b->spacing[axis]) > 1e-4 * fabs(a->spacing[axis]))
            return false;
    }
    return true;
}

struct stack {
    const struct dicom_frame *first;
    uint32_t count, number; /* of its first frame, from 1 */
};

static bool is_in_stack(const struct dicom_slice *slice, const void *user) {
    return is_same_stack(&slice->is, user);
}

static unsigned list_stacks(const struct dicom_slices *slices, struct stack *stacks) {
    unsigned count = 0;
    for (uint32_t i = 0; i < slices->count; i++) {
        const struct dicom_frame *is = &slices->items[i].is;
        unsigned n = 0;
        while (n < count && !is_same_stack(stacks[n].first, is))
            n++;
        if (n == count && count < STACKS_MAX)
            stacks[count++] = (struct stack){ is, 0, i + 1 };
        if (n < count)
            stacks[n].count++;
    }
    return count;
}

/* Keeps the largest stack, and says which ones are left out. */
static void keep_stack(struct dicom_slices *slices, const struct dicom_source *source) {
    struct stack stacks[STACKS_MAX];
    char others[140] = "";
    struct import_list list;
    const unsigned count = list_stacks(slices, stacks);
    const uint32_t all = slices->count;
    unsigned best = 0;
    if (count < 2)
        return;
    for (unsigned n = 1; n < count; n++)
        if (stacks[n].count > stacks[best].count)
            best = n;
    import_list_begin(&list, others, sizeof others);
    for (unsigned n = 0; n < count; n++) {
        const char *name = stacks[n].first->stack;
        char one[64];
        snprintf(one, sizeof one, "%s%.20s%s%u%s from frame %u on", *name ? "stack " : "", name,
                 *name ? ": " : "", stacks[n].count,
                 stacks[n].first->is_placed ? "" : " without a place", stacks[n].number);
        if (n != best)
            import_list_add(&list, list.used ? ", " : "", one);
    }
    import_list_end(&list, false);
    const struct dicom_frame kept = *stacks[best].first;
    dicom_slices_keep(slices, is_in_stack, &kept);
    if (slices->count < all)
        import_warn(source->file->warnings,
                    "Left out %u frames of other stacks, directions, spacings or without a place "
                    "(%s); the largest stack is shown.",
                    all - slices->count, others);
}

/* True if the file has its frames against the normal, from each time or echo to the next. */
static bool is_falling(const struct dicom_slices *slices) {
    const struct dicom_slice *s = slices->items;
    const struct sp_vec3 normal =
        sp_vec3_cross(sp_vec3_from(s[0].is.along[0]), sp_vec3_from(s[0].is.along[1]));
    double low = INFINITY, high = -INFINITY, before = NAN;
    for (uint32_t i = 0; i < slices->count; i++) {
        const double place = sp_vec3_dot(sp_vec3_from(s[i].is.position), normal);
        low = fmin(low, place);
        high = fmax(high, place);
    }
    const double near = 1e-3 * (high - low);
    bool has_fallen = false;
    for (uint32_t i = 0; i < slices->count; i++) {
        const double place = sp_vec3_dot(sp_vec3_from(s[i].is.position), normal);
        const double rise = i > 0 ? place - before : 0;
        before = place;
        if (rise > near && !(has_fallen && rise >= high - low - near))
            return false;
        has_fallen |= rise < -near;
    }
    return has_fallen;
}

static bool fail_memory(const struct dicom_source *source, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, source->file->title, "out of memory for the frames");
}

static bool describe_frames(const struct dicom_source *source, const char *name,
                            struct dicom_frame *frames, uint32_t count, struct sp_error *err) {
    char path[40];
    struct sp_error why;
    const int fd = dicom_open(source, name, err);
    if (fd < 0)
        return false;
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    const bool ok = source->call->describe_frames(path, frames, count, &why);
    dicom_close(source, fd);
    return ok || dicom_fail(source, why.code, name, why.text, err);
}

static bool check_count(const struct dicom_source *source, const char *name, uint64_t count,
                        struct sp_error *err) {
    char text[SP_ERROR_TEXT];
    snprintf(text, sizeof text, "there are %" PRIu64 " frames; the limit is %d", count,
             DICOM_FRAMES_MAX);
    return count <= DICOM_FRAMES_MAX || dicom_fail(source, SP_ERR_UNSUPPORTED, name, text, err);
}

bool dicom_frames_add(const struct dicom_source *source, const char *name,
                      const struct dicom_image *image, struct dicom_slices *slices,
                      struct sp_error *err) {
    const uint32_t count = image->frames;
    if (count <= 1)
        return dicom_slices_add(slices, name, 0, false, &image->first) || fail_memory(source, err);
    if (!check_count(source, name, (uint64_t)slices->count + count, err))
        return false;
    struct dicom_frame *frames = calloc(count, sizeof *frames);
    bool ok = frames ? describe_frames(source, name, frames, count, err) : fail_memory(source, err);
    for (uint32_t i = 0; ok && i < count; i++)
        ok = dicom_slices_add(slices, name, i, true, &frames[i]) || fail_memory(source, err);
    free(frames);
    return ok;
}

bool dicom_frames_choose(const struct dicom_source *source, struct dicom_slices *slices,
                         struct sp_error *err) {
    keep_stack(slices, source);
    if (slices->count == 0)
        return dicom_fail(source, SP_ERR_FORMAT, "", "no frame has a valid direction", err);
    slices->is_falling = slices->items[0].is.is_placed && is_falling(slices);
    return true;
}
