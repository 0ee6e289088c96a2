/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/dicom_folder.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "data/import/dicom_frames.h"

enum { LIST = 160, UID_END = 12 }; /* bytes of a list of names; of a UID that tells series apart */

/* Adds a name to a list. */
__attribute__((format(printf, 2, 3))) static void append(struct import_list *list,
                                                         const char *format, ...) {
    char item[160];
    va_list args;
    va_start(args, format);
    vsnprintf(item, sizeof item, format, args);
    va_end(args);
    import_list_add(list, list->used ? ", " : "", item);
}

/* What warnings call a file. */
static const char *name_of(const struct dicom_source *source, const char *name) {
    const char *slash = strrchr(source->file->title, '/');
    return *name ? name : slash ? slash + 1 : source->file->title;
}

/* The choice of a series. */

/* The last bytes of the unique id of a series. */
static const char *uid_end(const struct dicom_image *image) {
    const size_t n = strlen(image->series);
    return image->series + (n > UID_END ? n - UID_END : 0);
}

/* How well a series matches a text: its unique id, its number, its description, the end of the
 * unique id, a part of the description. */
static int match(const struct dicom_image *image, const char *wanted) {
    char number[24];
    snprintf(number, sizeof number, "%ld", image->number);
    return strcmp(image->series, wanted) == 0                 ? 5
           : image->has_number && strcmp(number, wanted) == 0 ? 4
           : strcasecmp(image->description, wanted) == 0      ? 3
           : strcmp(uid_end(image), wanted) == 0              ? 2
           : strcasestr(image->description, wanted) != NULL   ? 1
                                                              : 0;
}

/* True if neither number nor description tells the series from the others. */
static bool is_unnamed(const struct dicom_scan *scan, const struct dicom_image *image) {
    for (uint32_t n = 0; n < scan->stack_count; n++) {
        const struct dicom_image *other = dicom_scan_image(scan, n);
        if (!dicom_is_same_series(other, image) && other->has_number == image->has_number &&
            other->number == image->number && strcmp(other->description, image->description) == 0)
            return true;
    }
    return !image->has_number && !image->description[0];
}

/* How many bytes of a text fit, without a part of a UTF-8 character. */
static int fitting(const char *text, size_t most) {
    size_t n = strlen(text);
    if (n > most)
        for (n = most; n > 0 && ((unsigned char)text[n] & 0xc0) == 0x80;)
            n--;
    return (int)n;
}

/* "NUMBER "DESCRIPTION" (n images)"; "MR …1.2.3 (n images)" where these do not tell them apart. */
static void append_series(const struct dicom_scan *scan, uint32_t n, struct import_list *list) {
    const struct dicom_stack *stack = &scan->stacks[n];
    const struct dicom_image *image = &scan->images[stack->first].image;
    char number[24] = "", description[72] = "", uid[72] = "";
    if (list->left_out > 0) { /* it only counts */
        import_list_add(list, "", "");
        return;
    }
    if (image->has_number)
        snprintf(number, sizeof number, "%ld ", image->number);
    if (image->description[0])
        snprintf(description, sizeof description, "\"%.*s\" ", fitting(image->description, 30),
                 image->description);
    if (is_unnamed(scan, image))
        snprintf(uid, sizeof uid, "%.20s%s…%s ", image->modality, image->modality[0] ? " " : "",
                 uid_end(image));
    append(list, "%s%s%s(%u %s)", number, description, uid, stack->frames,
           stack->frames == 1 ? "image" : "images");
}

static bool fail_unknown(const struct dicom_source *source, const struct dicom_scan *scan,
                         struct sp_error *err) {
    char text[LIST] = "";
    struct import_list list;
    import_list_begin(&list, text, sizeof text);
    for (uint32_t n = 0; n < scan->stack_count; n++)
        if (scan->stacks[n].is_main)
            append_series(scan, n, &list);
    import_list_end(&list, false);
    return sp_fail(err, SP_ERR_NOT_FOUND, source->file->title,
                   "there is no series \"%.64s\"; there are: %s", source->file->selection.series,
                   text);
}

/* Chooses the largest stack of the series that the source names, or else of all series. */
static bool choose_largest(const struct dicom_source *source, const struct dicom_scan *scan,
                           uint32_t *chosen, struct sp_error *err) {
    const char *wanted = source->file->selection.series;
    int best = -1;
    for (uint32_t n = 0; n < scan->stack_count; n++) {
        const int matched = *wanted ? match(dicom_scan_image(scan, n), wanted) : 0;
        if (matched > best || (matched == best && dicom_scan_larger(scan, *chosen, n) == n))
            *chosen = n;
        best = matched > best ? matched : best;
    }
    return !*wanted || best > 0 || fail_unknown(source, scan, err);
}

static bool choose(const struct dicom_source *source, const struct dicom_scan *scan,
                   uint32_t *chosen, struct sp_error *err) {
    const struct import_file *file = source->file;
    *chosen = 0;
    if (scan->stack_count == 0)
        return sp_fail(err, SP_ERR_NOT_FOUND, file->title,
                       scan->damaged.count ? "no DICOM image in this folder can be read: %.255s"
                                           : "there is no DICOM image in this folder%s",
                       scan->damaged.count ? scan->damaged.names[0] : "");
    if (!source->is_named)
        return choose_largest(source, scan, chosen, err);
    return !*file->selection.series || match(&source->image, file->selection.series) > 0 ||
           sp_fail(err, SP_ERR_NOT_FOUND, file->title,
                   "the file belongs to the series %.64s, not to \"%.64s\"; open the folder to "
                   "choose another series",
                   source->image.series, file->selection.series);
}

/* Warnings. */

/* Warns that the folder has other series, or others that ?series= fits equally well. */
static void warn_of_series(const struct dicom_source *source, const struct dicom_scan *scan,
                           uint32_t chosen) {
    enum { REST = 110 }; /* bytes of the sentences without the names */
    char chosen_text[LIST] = "", others[SP_WARNING_BYTES] = "";
    struct import_list list;
    unsigned count = 0;
    const char *wanted = source->file->selection.series;
    const int matched = match(dicom_scan_image(scan, chosen), wanted);
    import_list_begin(&list, chosen_text, sizeof chosen_text);
    append_series(scan, chosen, &list);
    const size_t left = SP_WARNING_BYTES - REST, used = strlen(chosen_text);
    import_list_begin(&list, others, used + 60 < left ? left - used : 60);
    for (uint32_t n = 0; n < scan->stack_count; n++)
        if (scan->stacks[n].is_main &&
            !dicom_is_same_series(dicom_scan_image(scan, n), dicom_scan_image(scan, chosen)) &&
            (!*wanted || match(dicom_scan_image(scan, n), wanted) == matched)) {
            append_series(scan, n, &list);
            count++;
        }
    import_list_end(&list, false);
    if (count > 0)
        import_warn(source->file->warnings,
                    "This is series %s, the largest of %u. The others are %s. ?series= chooses by "
                    "number, description or UID.",
                    chosen_text, count + 1, others);
}

/* Other stacks of the same series. */
static void warn_of_stacks(const struct dicom_source *source, const struct dicom_scan *scan,
                           uint32_t chosen) {
    char text[LIST] = "";
    struct import_list list;
    unsigned count = 0;
    import_list_begin(&list, text, sizeof text);
    for (uint32_t i = 0; i < scan->count; i++) {
        const struct dicom_found *found = &scan->images[i];
        if (found->is_copy || found->stack == chosen ||
            !dicom_is_same_series(&found->image, dicom_scan_image(scan, chosen)))
            continue;
        append(&list, "%.60s", name_of(source, found->name));
        count += found->image.frames;
    }
    import_list_end(&list, false);
    if (count > 0)
        import_warn(source->file->warnings,
                    "Left out %u other %s of the series, whose size, kind, spacing, direction or "
                    "patient differs: %s.",
                    count, count > 1 ? "images" : "image", text);
}

static void warn_of_files(const struct dicom_source *source, const struct dicom_scan *scan) {
    char copies[LIST] = "", damaged[SP_WARNING_BYTES - 44] = ""; /* 44: the sentence */
    struct import_list list;
    import_list_begin(&list, copies, sizeof copies);
    for (uint32_t i = 0; i < scan->count; i++)
        if (scan->images[i].is_copy)
            append(&list, "%.50s (of %.50s)", name_of(source, scan->images[i].name),
                   name_of(source, scan->images[scan->images[i].copy_of].name));
    import_list_end(&list, false);
    import_list_begin(&list, damaged, sizeof damaged);
    for (uint32_t i = 0; i < scan->damaged.count; i++)
        append(&list, "%.130s", scan->damaged.names[i]);
    import_list_end(&list, false);
    if (scan->copies > 0)
        import_warn(source->file->warnings,
                    "Left out %u %s with the same SOPInstanceUID or pixels: %s.", scan->copies,
                    scan->copies > 1 ? "copies" : "copy", copies);
    if (scan->damaged.count > 0)
        import_warn(source->file->warnings, "Left out %u %s that cannot be read: %s.",
                    scan->damaged.count, scan->damaged.count > 1 ? "files" : "file", damaged);
    if (scan->is_bounded)
        import_warn(source->file->warnings,
                    "Some files were not looked at: the limits are %d files and %d folders below. "
                    "Open the folder of one series.",
                    IMPORT_FILES_MAX, DICOM_FOLDERS_MAX);
}

/* Positions in different frames of reference have nothing to do with each other. */
static void warn_of_spaces(const struct dicom_source *source, const struct dicom_scan *scan,
                           uint32_t chosen) {
    const struct dicom_image *first = dicom_scan_image(scan, chosen);
    char text[LIST] = "";
    struct import_list list;
    unsigned count = 0;
    import_list_begin(&list, text, sizeof text);
    for (uint32_t i = 0; i < scan->count; i++) {
        const struct dicom_found *found = &scan->images[i];
        if (found->is_copy || found->stack != chosen ||
            strcmp(found->image.space, first->space) == 0)
            continue;
        append(&list, "%.60s", name_of(source, found->name));
        count++;
    }
    import_list_end(&list, false);
    if (count > 0 && first->first.is_placed)
        import_warn(
            source->file->warnings,
            "The places of %u %s may be wrong: FrameOfReferenceUID differs from that of the "
            "others: %s.",
            count, count > 1 ? "images" : "image", text);
}

/* The slices. */

static int by_instance(const void *a, const void *b) {
    const struct dicom_found *const *p = a, *const *q = b;
    const long x = (*p)->image.first.instance, y = (*q)->image.first.instance;
    return x != y ? (x > y) - (x < y) : (*p > *q) - (*p < *q);
}

/* Images without a position lie above one another in the order of their numbers, or of their
 * names. */
static void order_unplaced(const struct dicom_source *source, struct dicom_found **found,
                           uint32_t count) {
    if (count < 2 || found[0]->image.first.is_placed)
        return;
    bool has_numbers = true;
    qsort(found, count, sizeof *found, by_instance);
    for (uint32_t i = 0; i < count; i++) {
        found[i]->image.first.slot = i;
        has_numbers &=
            i == 0 || found[i]->image.first.instance != found[i - 1]->image.first.instance;
    }
    import_warn(
        source->file->warnings, "%s: they are shown in the order of their %s.",
        found[0]->image.first.is_turned_wrong
            ? "The directions of the images (ImageOrientationPatient) are not of length 1, or "
              "not perpendicular"
            : "The images have no position",
        has_numbers ? "instance numbers" : "names");
}

static bool add_slices(const struct dicom_source *source, struct dicom_scan *scan, uint32_t chosen,
                       struct dicom_slices *slices, struct sp_error *err) {
    struct dicom_found **found = malloc(scan->count * sizeof *found);
    uint32_t count = 0;
    if (!found)
        return sp_fail(err, SP_ERR_MEMORY, source->file->title, "out of memory for the slices");
    for (uint32_t i = 0; i < scan->count; i++)
        if (!scan->images[i].is_copy && scan->images[i].stack == chosen)
            found[count++] = &scan->images[i];
    order_unplaced(source, found, count);
    bool ok = true;
    for (uint32_t i = 0; ok && i < count; i++)
        ok = dicom_frames_add(source, found[i]->name, &found[i]->image, slices, err);
    free(found);
    return ok;
}

static bool read_stack(struct dicom_source *source, struct dicom_scan *scan,
                       struct dicom_slices *slices, struct sp_error *err) {
    uint32_t chosen;
    if (!choose(source, scan, &chosen, err))
        return false;
    const struct dicom_stack *stack = &scan->stacks[chosen];
    const struct dicom_found *first = &scan->images[stack->first];
    if (!source->is_named)
        warn_of_series(source, scan, chosen);
    if (!source->is_named || first->image.frames <= 1 || stack->frames > first->image.frames) {
        warn_of_stacks(source, scan, chosen);
        warn_of_spaces(source, scan, chosen);
        warn_of_files(source, scan);
    }
    source->image = first->image;
    snprintf(source->name, sizeof source->name, "%s", first->name);
    return add_slices(source, scan, chosen, slices, err);
}

bool dicom_folder_list(struct dicom_source *source, struct dicom_slices *slices,
                       struct sp_error *err) {
    struct dicom_scan scan = { .count = 0 };
    const bool ok = dicom_scan_read(source, &scan, err) && read_stack(source, &scan, slices, err);
    dicom_scan_finish(&scan);
    return ok;
}
