/* SPDX-License-Identifier: Apache-2.0
 *
 * Keys that other programs add to a NRRD header ("Segment0_Name:=Liver"): diffusion files,
 * segmentations and sequences of 3D Slicer.
 */
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "data/import/nrrd_header.h"

/* Returns the value if the line has this key, else NULL. */
static char *value_of(char *line, const char *key) {
    const size_t n = strlen(key);
    return strncmp(line, key, n) == 0 && strncmp(line + n, ":=", 2) == 0 ? line + n + 2 : NULL;
}

/* "Segment3_Name", "Segment3_Layer". Segments beyond the last number have no name. */
static void parse_segment(struct nrrd_segments *segments, char *line) {
    enum { PREFIX = 7 };
    char *rest, *value;
    if (strncmp(line, "Segmentation_", 13) == 0)
        segments->are_there = true;
    if (strncmp(line, "Segment", PREFIX) != 0 || !isdigit((unsigned char)line[PREFIX]))
        return;
    segments->are_there = true;
    const unsigned long number = strtoul(line + PREFIX, &rest, 10);
    if (number >= NRRD_SEGMENTS_MAX)
        return;
    if ((value = value_of(rest, "_Name")) != NULL)
        segments->names[number] = value;
    else if ((value = value_of(rest, "_Layer")) != NULL)
        segments->layers[number] = (unsigned)strtoul(value, NULL, 10);
}

/* "axis 0 index values", the times of a sequence; "MultiVolume.FrameLabels" is an older name. */
static void parse_sequence(struct nrrd_header *h, char *line) {
    char *value;
    if (strncmp(line, "axis ", 5) == 0 && isdigit((unsigned char)line[5])) {
        char *rest;
        strtoul(line + 5, &rest, 10);
        if ((value = value_of(rest, " index values")) != NULL)
            h->times = value;
        else if ((value = value_of(rest, " index unit")) != NULL)
            h->times_unit = value;
    } else if (!h->times && (value = value_of(line, "MultiVolume.FrameLabels")) != NULL) {
        h->times = value;
    } else if (!h->times_unit &&
               (value = value_of(line, "MultiVolume.FrameIdentifyingDICOMTagUnits")) != NULL) {
        h->times_unit = value;
    }
}

void nrrd_keys_parse(struct nrrd_header *h, char *line) {
    h->is_diffusion |= strncmp(line, "DWMRI_", 6) == 0 ||
                       (strncmp(line, "modality:=", 10) == 0 && strstr(line, "DWMRI"));
    parse_segment(&h->segments, line);
    parse_sequence(h, line);
}

static bool is_taken(const char names[][SP_FIELD_BYTES], unsigned count, const char *name) {
    for (unsigned i = 0; i < count; i++)
        if (strcmp(names[i], name) == 0)
            return true;
    return false;
}

/* Joins the names of the segments of a layer. */
static void name_layer(const struct nrrd_segments *s, unsigned layer, char name[SP_FIELD_BYTES]) {
    struct import_list list;
    name[0] = 0;
    import_list_begin(&list, name, SP_FIELD_BYTES);
    for (unsigned i = 0; i < NRRD_SEGMENTS_MAX; i++)
        if (s->names[i] && s->names[i][0] && s->layers[i] == layer) {
            char own[SP_FIELD_BYTES];
            import_name(own, s->names[i]);
            if (list.used == 0 && strlen(own) + 1 < SP_FIELD_BYTES)
                list.used = (size_t)snprintf(name, SP_FIELD_BYTES, "%s", own);
            else
                import_list_add(&list, ", ", own);
        }
    import_list_end(&list, false);
}

void nrrd_keys_name_layers(struct nrrd_segments *s, unsigned count) {
    s->layer_count = count < NRRD_LAYERS_MAX ? count : NRRD_LAYERS_MAX;
    for (unsigned i = 0; i < s->layer_count; i++) {
        char *name = s->layer_names[i];
        name_layer(s, i, name);
        if ((!name[0] && count > 1) ||
            is_taken((const char(*)[SP_FIELD_BYTES])s->layer_names, i, name))
            snprintf(name, SP_FIELD_BYTES, "layer %u", i + 1);
        s->layer_list[i] = name;
    }
}

bool nrrd_keys_read_times(const struct nrrd_header *h, double *times, uint64_t count) {
    const char *at = h->times;
    for (uint64_t i = 0; i < count; i++) {
        char *end;
        times[i] = strtod(at, &end);
        if (end == at || !isfinite(times[i]) || (i > 0 && !(times[i] > times[i - 1])))
            return false;
        at = end + strspn(end, ", \t");
    }
    return !*at;
}
