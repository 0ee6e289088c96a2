/* SPDX-License-Identifier: Apache-2.0
 *
 * The series of a folder, as a list for the user.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/dicom_scan.h"

/* The entry of the series of an image; NULL = the list is full. */
static struct sp_series *find_or_add_entry(struct import_series_list *list,
                                           const struct dicom_image *image) {
    for (uint32_t i = 0; i < list->count; i++)
        if (strcmp(list->items[i].uid, image->series) == 0)
            return &list->items[i];
    if (list->count == SP_SERIES_MAX)
        return NULL;
    struct sp_series *entry = &list->items[list->count++];
    *entry =
        (struct sp_series){ .has_number = image->has_number, .number = (int32_t)image->number };
    snprintf(entry->uid, sizeof entry->uid, "%s", image->series);
    snprintf(entry->description, sizeof entry->description, "%s", image->description);
    snprintf(entry->modality, sizeof entry->modality, "%s", image->modality);
    return entry;
}

static int by_number(const void *a, const void *b) {
    const struct sp_series *p = a, *q = b;
    if (p->has_number != q->has_number)
        return q->has_number - p->has_number;
    return p->number != q->number ? (p->number > q->number) - (p->number < q->number)
                                  : strcmp(p->uid, q->uid);
}

static void add_stacks(const struct dicom_scan *scan, struct import_series_list *list) {
    uint32_t largest[SP_SERIES_MAX] = { 0 }; /* images of the largest stack of each entry */
    for (uint32_t n = 0; n < scan->stack_count; n++) {
        const struct dicom_stack *stack = &scan->stacks[n];
        const struct dicom_image *image = dicom_scan_image(scan, n);
        struct sp_series *entry = find_or_add_entry(list, image);
        if (!entry)
            continue;
        entry->images += stack->frames;
        entry->bytes += stack->bytes;
        uint32_t *most = &largest[entry - list->items];
        if (stack->frames <= *most)
            continue;
        *most = stack->frames;
        entry->columns = image->columns;
        entry->rows = image->rows;
    }
    if (list->count > 1)
        qsort(list->items, list->count, sizeof *list->items, by_number);
}

bool dicom_list_series(const struct dicom_source *source, struct import_series_list *list,
                       struct sp_error *err) {
    struct dicom_scan scan = { .count = 0 };
    const bool ok = dicom_scan_read(source, &scan, err);
    if (ok)
        add_stacks(&scan, list);
    dicom_scan_finish(&scan);
    return ok;
}
