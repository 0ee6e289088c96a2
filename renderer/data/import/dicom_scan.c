/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/dicom_scan.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/grow.h"
#include "data/import/dicom_samples.h"
#include "data/import/numbered.h"

/* Of sub-folders. A study on a disc has patient, study, series and image below each other. */
enum { DEPTH_MAX = 8 };
/* Files that are no images, of one folder, whose names are compared with those of images. */
enum { DOUBTS_MAX = 1 << 10 };

#define NONE UINT32_MAX /* in place of a stack */

#define SAME_SPACING 1e-3 /* share of the spacing */

void dicom_scan_finish(struct dicom_scan *scan) {
    for (uint32_t i = 0; i < scan->count; i++)
        free(scan->images[i].name);
    free(scan->images);
    free(scan->stacks);
    import_names_finish(&scan->damaged);
    *scan = (struct dicom_scan){ .count = 0 };
}

/* Stacks. */

bool dicom_is_same_series(const struct dicom_image *a, const struct dicom_image *b) {
    return strcmp(a->series, b->series) == 0;
}

static bool is_same_direction(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] > 0.9999;
}

static bool is_same_spacing(double a, double b) {
    return fabs(a - b) <= SAME_SPACING * fmax(fabs(a), fabs(b));
}

static bool is_same_geometry(const struct dicom_frame *a, const struct dicom_frame *b) {
    return a->is_placed == b->is_placed && is_same_spacing(a->spacing[0], b->spacing[0]) &&
           is_same_spacing(a->spacing[1], b->spacing[1]) &&
           (!a->is_placed || (is_same_direction(a->along[0], b->along[0]) &&
                              is_same_direction(a->along[1], b->along[1])));
}

/* True if images of other files may join the stack of this image. Frames of a film, a dose or a
 * segmentation never join frames of other files. */
static bool is_joinable(const struct dicom_image *image) {
    return image->frames == 1 || (image->has_places && image->series[0]);
}

/* Without a series, only a position shows that two images belong together. */
static bool belongs(const struct dicom_image *one, const struct dicom_image *other) {
    return dicom_is_same_series(one, other) && (one->series[0] || one->first.is_placed) &&
           is_joinable(one) && is_joinable(other) && one->columns == other->columns &&
           one->rows == other->rows && strcmp(one->patient, other->patient) == 0 &&
           one->channels == other->channels && one->colors == other->colors &&
           one->is_float == other->is_float && is_same_geometry(&one->first, &other->first);
}

static void count_image(struct dicom_stack *stack, const struct dicom_found *found) {
    const struct dicom_image *image = &found->image;
    stack->frames += image->frames;
    stack->bytes += found->bytes;
    stack->samples += (uint64_t)image->columns * image->rows * image->frames;
}

static int by_series(const void *a, const void *b, void *images) {
    const struct dicom_found *found = images;
    return strcmp(found[*(const uint32_t *)a].image.series,
                  found[*(const uint32_t *)b].image.series);
}

/* `order` is memory for the indices of all images. */
static void number_series(struct dicom_scan *scan, uint32_t *order) {
    uint32_t series = 0;
    for (uint32_t i = 0; i < scan->count; i++)
        order[i] = i;
    qsort_r(order, scan->count, sizeof *order, by_series, scan->images);
    for (uint32_t i = 0; i < scan->count; i++) {
        struct dicom_found *found = &scan->images[order[i]];
        series += i > 0 && !dicom_is_same_series(&scan->images[order[i - 1]].image, &found->image);
        found->series = series;
    }
}

/* Finds the stack of an image among the stacks of its series, the newest first; NONE = the image
 * begins a stack. */
static uint32_t find_stack(const struct dicom_scan *scan, const struct dicom_image *image,
                           uint32_t newest) {
    for (uint32_t n = newest; n != NONE; n = scan->stacks[n].next)
        if (belongs(dicom_scan_image(scan, n), image))
            return n;
    return NONE;
}

/* Puts each image into its stack. `newest`: of each series. */
static void fill_stacks(struct dicom_scan *scan, uint32_t *newest) {
    for (uint32_t i = 0; i < scan->count; i++)
        newest[i] = NONE;
    for (uint32_t i = 0; i < scan->count; i++) {
        struct dicom_found *found = &scan->images[i];
        if (found->is_copy)
            continue;
        uint32_t n = find_stack(scan, &found->image, newest[found->series]);
        if (n == NONE) {
            n = scan->stack_count++;
            scan->stacks[n] = (struct dicom_stack){ .first = i, .next = newest[found->series] };
            newest[found->series] = n;
        }
        found->stack = n;
        count_image(&scan->stacks[n], found);
    }
}

/* `main`: memory for the largest stack of each series. */
static void mark_main(struct dicom_scan *scan, uint32_t *main) {
    for (uint32_t i = 0; i < scan->count; i++)
        main[i] = NONE;
    for (uint32_t n = 0; n < scan->stack_count; n++) {
        uint32_t *largest = &main[scan->images[scan->stacks[n].first].series];
        *largest = *largest == NONE ? n : dicom_scan_larger(scan, *largest, n);
    }
    for (uint32_t i = 0; i < scan->count; i++)
        if (main[i] != NONE)
            scan->stacks[main[i]].is_main = true;
}

static bool make_stacks(struct dicom_scan *scan) {
    uint32_t *numbers = malloc((scan->count ? scan->count : 1) * sizeof *numbers);
    scan->stacks = calloc(scan->count ? scan->count : 1, sizeof *scan->stacks);
    const bool ok = numbers && scan->stacks;
    if (ok) {
        number_series(scan, numbers);
        fill_stacks(scan, numbers);
        mark_main(scan, numbers);
    }
    free(numbers);
    return ok;
}

uint32_t dicom_scan_larger(const struct dicom_scan *scan, uint32_t a, uint32_t b) {
    const struct dicom_stack *p = &scan->stacks[a], *q = &scan->stacks[b];
    if (p->frames != q->frames)
        return p->frames > q->frames ? a : b;
    if (p->samples != q->samples)
        return p->samples > q->samples ? a : b;
    return scan->images[q->first].image.number < scan->images[p->first].image.number ? b : a;
}

/* Copies. Some programs give all images one unique id, so copies have the same place and number,
 * too. Others give copies ids of their own: then the pixels tell. */

static int compare_images(const struct dicom_image *a, const struct dicom_image *b) {
    const struct dicom_frame *p = &a->first, *q = &b->first;
    int order = strcmp(a->series, b->series);
    if (order == 0)
        order = (p->instance > q->instance) - (p->instance < q->instance);
    for (int i = 0; order == 0 && i < 3; i++)
        order = dicom_compare_numbers(p->position[i], q->position[i]);
    for (int i = 0; order == 0 && i < 6; i++)
        order = dicom_compare_numbers(p->along[i / 3][i % 3], q->along[i / 3][i % 3]);
    for (int key = 0; order == 0 && key < DICOM_KEYS_OF_ORDER; key++)
        order = dicom_compare_numbers(p->keys[key], q->keys[key]);
    if (order == 0)
        order = dicom_compare_numbers(p->slope, q->slope);
    if (order == 0)
        order = dicom_compare_numbers(p->intercept, q->intercept);
    for (int text = 0; order == 0 && text < DICOM_TEXT_COUNT; text++)
        order = strcmp(p->texts[text], q->texts[text]);
    if (order == 0)
        order = (a->columns > b->columns) - (a->columns < b->columns);
    return order ? order : (a->rows > b->rows) - (a->rows < b->rows);
}

struct by_image {
    const struct dicom_found *images;
    bool has_ids; /* copies have the same id */
};

/* Indices of images, copies beside each other: "a.dcm" before "a (copy).dcm", and the file that
 * was opened before all others. */
static int by_image(const void *a, const void *b, void *user) {
    const struct by_image *by = user;
    const uint32_t i = *(const uint32_t *)a, k = *(const uint32_t *)b;
    const struct dicom_found *p = &by->images[i], *q = &by->images[k];
    const size_t n = i == 0 ? 0 : strlen(p->name), m = k == 0 ? 0 : strlen(q->name);
    int order = by->has_ids ? strcmp(p->image.id, q->image.id) : 0;
    if (order == 0)
        order = compare_images(&p->image, &q->image);
    return order ? order : n != m ? (n > m) - (n < m) : (i > k) - (i < k);
}

/* True if two files have the same bytes from their pixels on. */
static bool is_same_pixels(const struct dicom_source *source, const struct dicom_found *a,
                           const struct dicom_found *b) {
    enum { BLOCK = 1 << 14 };
    uint64_t from = a->image.pixels_at, to = b->image.pixels_at;
    struct sp_error ignored;
    char one[BLOCK], other[BLOCK];
    if (!from || !to || a->bytes - from != b->bytes - to)
        return false;
    const int first = dicom_open(source, a->name, &ignored);
    const int second = dicom_open(source, b->name, &ignored);
    bool is_same = first >= 0 && second >= 0;
    for (ssize_t got = 1; is_same && got > 0; from += BLOCK, to += BLOCK) {
        got = pread(first, one, BLOCK, (off_t)from);
        is_same = got >= 0 && pread(second, other, BLOCK, (off_t)to) == got &&
                  memcmp(one, other, (size_t)got) == 0;
    }
    dicom_close(source, first);
    dicom_close(source, second);
    return is_same;
}

static bool is_copy(const struct dicom_source *source, const struct dicom_found *found,
                    const struct dicom_found *of, bool has_ids) {
    if (compare_images(&found->image, &of->image) != 0)
        return false;
    if (has_ids)
        return found->image.id[0] && strcmp(found->image.id, of->image.id) == 0;
    return found->image.first.is_placed && found->image.frames == of->image.frames &&
           is_same_pixels(source, found, of);
}

/* Marks all copies of an image but the first. `order` is memory for the indices of all images. */
static void mark_copies(const struct dicom_source *source, struct dicom_scan *scan, bool has_ids,
                        uint32_t *order) {
    struct by_image by = { scan->images, has_ids };
    uint32_t count = 0;
    for (uint32_t i = 0; i < scan->count; i++)
        if (!scan->images[i].is_copy)
            order[count++] = i;
    qsort_r(order, count, sizeof *order, by_image, &by);
    for (uint32_t i = 1, first = 0; i < count; i++) {
        struct dicom_found *found = &scan->images[order[i]];
        found->is_copy = is_copy(source, found, &scan->images[order[first]], has_ids);
        found->copy_of = order[first];
        scan->copies += found->is_copy;
        first = found->is_copy ? first : i;
    }
}

static bool mark_all_copies(const struct dicom_source *source, struct dicom_scan *scan) {
    uint32_t *order = malloc((scan->count ? scan->count : 1) * sizeof *order);
    if (!order)
        return false;
    mark_copies(source, scan, true, order);
    mark_copies(source, scan, false, order);
    free(order);
    return true;
}

/* Files. */

static bool add_image(struct dicom_scan *scan, const char *name, int fd,
                      const struct dicom_image *image) {
    struct stat st;
    if (!sp_grow(&scan->images, scan->count, sizeof *scan->images))
        return false;
    struct dicom_found *found = &scan->images[scan->count];
    *found = (struct dicom_found){ .name = strdup(name), .image = *image };
    found->bytes = fstat(fd, &st) == 0 ? (uint64_t)st.st_size : 0;
    scan->count += found->name != NULL;
    return found->name != NULL;
}

static bool add_damaged(struct dicom_scan *scan, const char *name, const char *why) {
    char text[SP_WARNING_BYTES];
    snprintf(text, sizeof text, "%.80s: %.140s", name, why);
    return import_names_append(&scan->damaged, text);
}

/* Gives the file that was opened its name in the folder. */
static bool name_first(struct dicom_scan *scan, const char *name) {
    char *copy = strdup(name);
    if (copy) {
        free(scan->images[0].name);
        scan->images[0].name = copy;
    }
    return copy != NULL;
}

/* True if the file was opened by its name, whatever the name is here. */
static bool is_opened(const struct dicom_source *source, int fd) {
    struct stat own, other;
    return !source->file->is_folder && fstat(source->file->fd, &own) == 0 &&
           fstat(fd, &other) == 0 && own.st_dev == other.st_dev && own.st_ino == other.st_ino;
}

/* What is wrong with a file that may be a slice. */
enum verdict { IS_IMAGE, IS_OTHER, IS_DAMAGED, IS_DOUBTFUL };

static enum verdict judge(const struct dicom_source *source, const char *name, int fd,
                          struct dicom_image *image, struct sp_error *err) {
    uint8_t start[DICOM_PREFIX];
    const ssize_t got = pread(fd, start, sizeof start, 0);
    if (got <= 0) {
        sp_fail(err, SP_ERR_FORMAT, "", "the file is empty");
        return dicom_has_ending(name) ? IS_DAMAGED : IS_DOUBTFUL;
    }
    if (!dicom_is_file(start, (size_t)got) && !dicom_has_ending(name)) {
        sp_fail(err, SP_ERR_FORMAT, "", "this is no DICOM file, or it is damaged");
        return IS_DOUBTFUL;
    }
    if (!dicom_describe(source, fd, image, err))
        return IS_DAMAGED;
    if (image->columns == 0)
        return IS_OTHER;
    return dicom_samples_check(image, fd, err) ? IS_IMAGE : IS_DAMAGED;
}

/* Adds a file of the folder to the images or the damaged files. A file that has neither the bytes
 * nor the name of a DICOM file comes to the doubts, with the reason. */
static bool add_file(const struct dicom_source *source, const char *name, struct dicom_scan *scan,
                     struct import_names *doubts) {
    struct dicom_image image;
    struct sp_error why;
    bool ok = true;
    int fd = dicom_open(source, name, &why);
    if (fd < 0)
        return true;
    if (is_opened(source, fd)) {
        ok = !source->is_named || name_first(scan, name);
    } else {
        switch (judge(source, name, fd, &image, &why)) {
        case IS_IMAGE:
            ok = add_image(scan, name, fd, &image);
            break;
        case IS_DAMAGED:
            ok = add_damaged(scan, name, why.text);
            break;
        case IS_DOUBTFUL:
            ok = doubts->count == DOUBTS_MAX || import_names_append(doubts, name);
            break;
        case IS_OTHER:
            break;
        }
    }
    dicom_close(source, fd);
    return ok;
}

/* A file is a damaged slice if its name differs from that of an image in numbers only. */
static bool resolve_doubts(struct dicom_scan *scan, const struct import_names *doubts) {
    char pattern[NAME_MAX + 1];
    bool ok = true;
    for (uint32_t i = 0; ok && i < doubts->count; i++) {
        bool is_alike = false;
        if (!sp_numbered_pattern(doubts->names[i], pattern))
            continue;
        for (uint32_t k = 0; k < scan->count && !is_alike; k++)
            is_alike = sp_numbered_matches(pattern, scan->images[k].name);
        if (is_alike)
            ok = add_damaged(scan, doubts->names[i], "this is no DICOM file, or it is damaged");
    }
    return ok;
}

/* Reads the files of one folder, "" or "SUB/FOLDER". */
static bool read_folder(const struct dicom_source *source, const char *prefix,
                        struct dicom_scan *scan) {
    struct import_names files = { .count = 0 }, doubts = { .count = 0 };
    char path[2 * PATH_MAX];
    snprintf(path, sizeof path, "%s/%s", source->file->folder, prefix);
    const uint32_t left = scan->count < IMPORT_FILES_MAX ? IMPORT_FILES_MAX - scan->count : 0;
    bool ok = import_names_add(&files, path, prefix, false, left);
    scan->is_bounded |= files.count == left;
    import_names_sort(&files, 0);
    for (uint32_t i = 0; ok && i < files.count; i++)
        ok = add_file(source, files.names[i], scan, &doubts);
    ok = ok && resolve_doubts(scan, &doubts);
    import_names_finish(&files);
    import_names_finish(&doubts);
    return ok;
}

static unsigned depth_of(const char *path) {
    unsigned depth = 0;
    for (; *path; path++)
        depth += *path == '/';
    return depth;
}

/* Reads the files of all folders below, level by level. */
static bool read_below(const struct dicom_source *source, struct dicom_scan *scan) {
    struct import_names folders = { .count = 0 };
    char path[2 * PATH_MAX];
    bool ok = import_names_add(&folders, source->file->folder, "", true, DICOM_FOLDERS_MAX);
    import_names_sort(&folders, 0);
    for (uint32_t i = 0; ok && i < folders.count; i++) {
        const uint32_t first = folders.count;
        snprintf(path, sizeof path, "%s/%s", source->file->folder, folders.names[i]);
        ok = read_folder(source, folders.names[i], scan);
        if (ok && depth_of(folders.names[i]) + 1 < DEPTH_MAX)
            ok = import_names_add(&folders, path, folders.names[i], true, DICOM_FOLDERS_MAX);
        import_names_sort(&folders, first);
    }
    scan->is_bounded |= folders.count == DICOM_FOLDERS_MAX;
    import_names_finish(&folders);
    return ok;
}

bool dicom_scan_read(const struct dicom_source *source, struct dicom_scan *scan,
                     struct sp_error *err) {
    bool ok = !source->is_named || add_image(scan, "", source->file->fd, &source->image);
    ok = ok && read_folder(source, "", scan);
    if (ok && !source->is_named)
        ok = read_below(source, scan);
    return (ok && mark_all_copies(source, scan) && make_stacks(scan)) ||
           sp_fail(err, SP_ERR_MEMORY, source->file->title, "out of memory for the slices");
}
