/* SPDX-License-Identifier: Apache-2.0
 *
 * OME-XML (Open Microscopy Environment, schema 2016-06) in the description of a TIFF. expat parses
 * it; a document type, and with it every entity, is refused.
 *
 *   OME ─► Image ─► Pixels (sizes, order, spacing) ─► Channel (name), TiffData (pages) ─► UUID
 */
#include <expat.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/axes.h"
#include "data/import/tiff_planes.h"
#include "data/volume/unit.h"

enum { DEPTH_MAX = 32, CHANNELS_MAX = 4096, UUID_BYTES = 80 };

/* Slices lie evenly if each is within this share of the step of its place. */
#define EVEN_SHARE 0.01

/* The axes of planes, as in DimensionOrder. */
enum { AXIS_Z, AXIS_C, AXIS_T };

struct block { /* a TiffData: pages that follow one another */
    uint32_t first[3];
    uint64_t page, count;
    bool has_page, has_count;
};

struct ome {
    struct tiff_planes *planes;
    const struct import_file *file;
    struct sp_error *err;
    XML_Parser parser;
    uint32_t pages;
    unsigned samples;
    bool failed, in_pixels, in_block, in_uuid, has_blocks;
    int depth;
    unsigned images, channels;
    unsigned order[3]; /* axes, the fastest first */
    struct block block;
    double *heights; /* owned: PositionZ of the first planes of the slices; NULL = unknown */
    char height_unit[SP_UNIT_BYTES];
    uint64_t assigned;                      /* pages of all blocks */
    char own[UUID_BYTES], uuid[UUID_BYTES]; /* of the file; of the planes of a block */
    char other[64];                         /* name of the file of those planes */
};

static void fail(struct ome *o, enum sp_code code, const char *text) {
    char place[SP_ERROR_PLACE];
    if (o->failed)
        return;
    o->failed = true;
    snprintf(place, sizeof place, "%.180s: OME-XML, line %lu", o->file->title,
             (unsigned long)XML_GetCurrentLineNumber(o->parser));
    sp_fail(o->err, code, place, "%s", text);
    XML_StopParser(o->parser, XML_FALSE);
}

static const char *attribute(const char **list, const char *name) {
    for (; *list; list += 2)
        if (strcmp(list[0], name) == 0)
            return list[1];
    return NULL;
}

/* A whole number; `missing` if there is none. */
static uint64_t whole(struct ome *o, const char **list, const char *name, uint64_t missing) {
    const char *text = attribute(list, name);
    char *end = NULL, why[96];
    if (!text)
        return missing;
    const long long value = strtoll(text, &end, 10);
    if (end > text && !*end && value >= 0 && value <= INT32_MAX)
        return (uint64_t)value;
    snprintf(why, sizeof why, "%.30s=\"%.30s\" is no whole number", name, text);
    fail(o, SP_ERR_FORMAT, why);
    return missing;
}

/* Elements. */

static void parse_order(struct ome *o, const char *order) {
    static const char letters[] = "ZCT";
    unsigned seen = 0;
    for (int i = 0; order && i < 3 && strlen(order) == 5; i++) {
        const char *letter = strchr(letters, order[2 + i]);
        if (!letter)
            break;
        o->order[i] = (unsigned)(letter - letters);
        seen |= 1U << o->order[i];
    }
    if (seen != 7 || strncmp(order, "XY", 2) != 0)
        fail(o, SP_ERR_FORMAT, "DimensionOrder must be XY and one each of Z, C and T");
}

static void parse_spacing(struct ome *o, const char **list) {
    static const char *const sizes[] = { "PhysicalSizeX", "PhysicalSizeY", "PhysicalSizeZ" };
    static const char *const names[] = { "PhysicalSizeXUnit", "PhysicalSizeYUnit",
                                         "PhysicalSizeZUnit" };
    struct tiff_planes *p = o->planes;
    for (int a = 0; a < 3; a++) {
        const char *size = attribute(list, sizes[a]), *name = attribute(list, names[a]);
        const struct sp_unit *unit = sp_unit_find(name ? name : "um");
        const double value = size ? strtod(size, NULL) : 0;
        if (!isfinite(value) || !(value > 0))
            continue;
        p->spacing[a] = value;
        if (!p->unit[0])
            snprintf(p->unit, sizeof p->unit, "%.31s", unit ? unit->symbol : name);
        tiff_planes_convert(p, o->file, a, unit ? unit->symbol : name);
    }
}

static void parse_pixels(struct ome *o, const char **list) {
    struct tiff_planes *p = o->planes;
    const char *interval = attribute(list, "TimeIncrement");
    const char *unit = attribute(list, "TimeIncrementUnit");
    const uint64_t channels = whole(o, list, "SizeC", 1);
    parse_order(o, attribute(list, "DimensionOrder"));
    p->slices = (uint32_t)whole(o, list, "SizeZ", 1);
    p->steps = (uint32_t)whole(o, list, "SizeT", 1);
    p->channels = (uint32_t)(channels / o->samples);
    if (channels % o->samples != 0)
        fail(o, SP_ERR_FORMAT, "SizeC is not a multiple of the channels of a page");
    parse_spacing(o, list);
    p->interval = interval ? strtod(interval, NULL) : 0;
    if (!isfinite(p->interval) || p->interval < 0)
        p->interval = 0;
    snprintf(p->time_unit, sizeof p->time_unit, "%.31s", unit ? unit : "s");
    if (!o->failed && !tiff_planes_allocate(p, o->file, o->pages, o->err)) {
        o->failed = true;
        XML_StopParser(o->parser, XML_FALSE);
    }
    if (!o->failed && p->channels <= CHANNELS_MAX)
        p->names = calloc(p->channels, sizeof *p->names);
}

/* If the file gives no interval, a step has the time of its first plane. Times that do not rise, or
 * that some steps lack, are dropped in finish(). */
static void parse_plane(struct ome *o, const char **list) {
    struct tiff_planes *p = o->planes;
    const char *time = attribute(list, "DeltaT"), *unit = attribute(list, "DeltaTUnit");
    const uint64_t step = whole(o, list, "TheT", 0);
    if (!time || p->interval > 0 || p->steps < 2 || step >= p->steps ||
        whole(o, list, "TheZ", 0) != 0 || whole(o, list, "TheC", 0) != 0)
        return;
    if (!p->times) {
        p->times = malloc(p->steps * sizeof *p->times);
        for (uint32_t i = 0; p->times && i < p->steps; i++)
            p->times[i] = NAN;
    }
    if (p->times)
        p->times[step] = strtod(time, NULL);
    snprintf(p->time_unit, sizeof p->time_unit, "%.31s", unit ? unit : "s");
}

/* A slice has the height of its first plane. */
static void parse_height(struct ome *o, const char **list) {
    const struct tiff_planes *p = o->planes;
    const char *height = attribute(list, "PositionZ"), *unit = attribute(list, "PositionZUnit");
    const uint64_t slice = whole(o, list, "TheZ", 0);
    if (!height || p->spacing[2] > 0 || slice >= p->slices || whole(o, list, "TheC", 0) != 0 ||
        whole(o, list, "TheT", 0) != 0)
        return;
    if (!o->heights) {
        o->heights = malloc(p->slices * sizeof *o->heights);
        for (uint32_t i = 0; o->heights && i < p->slices; i++)
            o->heights[i] = NAN;
    }
    if (o->heights)
        o->heights[slice] = strtod(height, NULL);
    snprintf(o->height_unit, sizeof o->height_unit, "%.31s", unit ? unit : "");
}

/* Without PhysicalSizeZ, the heights of the slices give their distance, if they are even and have a
 * unit of length; "reference frame" is none. */
static void compute_distance(struct ome *o) {
    struct tiff_planes *p = o->planes;
    const struct sp_unit *unit = sp_unit_find(o->height_unit);
    if (p->slices < 2 || !(p->spacing[0] > 0) || p->spacing[2] > 0 || !o->heights || !unit)
        return;
    const double step = (o->heights[p->slices - 1] - o->heights[0]) / (p->slices - 1);
    for (uint32_t i = 0; i < p->slices; i++)
        if (!(fabs(o->heights[i] - o->heights[0] - i * step) <= EVEN_SHARE * fabs(step)))
            return;
    if (!isfinite(step) || step == 0)
        return;
    p->spacing[2] = fabs(step);
    tiff_planes_convert(p, o->file, 2, unit->symbol);
}

static void check_times(struct tiff_planes *p) {
    bool are_sound = p->times != NULL;
    for (uint32_t i = 0; are_sound && i < p->steps; i++)
        are_sound = isfinite(p->times[i]) && (i == 0 || p->times[i] > p->times[i - 1]);
    if (!are_sound) {
        free(p->times);
        p->times = NULL;
    }
}

static void parse_channel(struct ome *o, const char **list) {
    const char *name = attribute(list, "Name");
    struct tiff_planes *p = o->planes;
    if (p->names && name && o->channels < p->channels)
        import_name(p->names[o->channels], name);
    o->channels++;
}

static void begin_block(struct ome *o, const char **list) {
    struct block *b = &o->block;
    *b = (struct block){ .has_page = attribute(list, "IFD") != NULL,
                         .has_count = attribute(list, "PlaneCount") != NULL };
    b->page = whole(o, list, "IFD", 0);
    b->count = whole(o, list, "PlaneCount", b->has_page ? 1 : o->pages);
    b->first[AXIS_Z] = (uint32_t)whole(o, list, "FirstZ", 0);
    b->first[AXIS_C] = (uint32_t)whole(o, list, "FirstC", 0) / o->samples;
    b->first[AXIS_T] = (uint32_t)whole(o, list, "FirstT", 0);
    o->in_block = true;
    o->uuid[0] = 0;
}

/* Assigns the pages of a block to planes, in DimensionOrder. */
static void end_block(struct ome *o) {
    struct tiff_planes *p = o->planes;
    const uint32_t sizes[3] = { p->slices, p->channels, p->steps };
    uint32_t at[3];
    char text[SP_ERROR_TEXT];
    o->in_block = false;
    o->has_blocks = true;
    if (!o->own[0]) /* nothing says which file this is: the first one that is named */
        memcpy(o->own, o->uuid, sizeof o->own);
    if (o->uuid[0] && strcmp(o->own, o->uuid) != 0) {
        snprintf(text, sizeof text,
                 "the planes are in several files, such as %.60s, which is not supported; save the "
                 "image as one file",
                 o->other[0] ? o->other : o->uuid);
        fail(o, SP_ERR_UNSUPPORTED, text);
        return;
    }
    memcpy(at, o->block.first, sizeof at);
    for (uint64_t i = 0; i < o->block.count && o->block.page + i < o->pages; i++) {
        if (at[AXIS_Z] >= sizes[AXIS_Z] || at[AXIS_C] >= sizes[AXIS_C] ||
            at[AXIS_T] >= sizes[AXIS_T])
            return; /* more pages than planes */
        if (o->assigned++ > 2 * (uint64_t)p->slices * p->channels * p->steps) {
            fail(o, SP_ERR_FORMAT, "the elements TiffData name every plane more than twice");
            return;
        }
        p->pages[((size_t)at[AXIS_T] * p->channels + at[AXIS_C]) * p->slices + at[AXIS_Z]] =
            (uint32_t)(o->block.page + i);
        for (int axis = 0; axis < 3; axis++) {
            if (++at[o->order[axis]] < sizes[o->order[axis]])
                break;
            if (axis < 2)
                at[o->order[axis]] = 0;
        }
    }
}

/* The name without the prefix of a namespace. */
static const char *plain(const char *name) {
    const char *colon = strrchr(name, ':');
    return colon ? colon + 1 : name;
}

static void start_element(void *user, const char *element, const char **list) {
    struct ome *o = user;
    const char *name = plain(element), *file_name = attribute(list, "FileName");
    if (++o->depth > DEPTH_MAX) {
        fail(o, SP_ERR_FORMAT, "the description has too many nested elements");
    } else if (strcmp(name, "OME") == 0) {
        snprintf(o->own, sizeof o->own, "%s",
                 attribute(list, "UUID") ? attribute(list, "UUID") : "");
    } else if (strcmp(name, "BinaryOnly") == 0) {
        fail(o, SP_ERR_UNSUPPORTED,
             "the description is in another file (BinaryOnly); several files of one image are not "
             "supported");
    } else if (strcmp(name, "Image") == 0) {
        o->images++;
    } else if (strcmp(name, "Pixels") == 0 && o->images == 1 && !o->planes->pages) {
        o->in_pixels = true;
        parse_pixels(o, list);
    } else if (o->in_pixels && strcmp(name, "Channel") == 0) {
        parse_channel(o, list);
    } else if (o->in_pixels && strcmp(name, "Plane") == 0) {
        parse_plane(o, list);
        parse_height(o, list);
    } else if (o->in_pixels && strcmp(name, "TiffData") == 0) {
        begin_block(o, list);
    } else if (o->in_block && strcmp(name, "UUID") == 0) {
        o->in_uuid = true;
        snprintf(o->other, sizeof o->other, "%s", file_name ? file_name : "");
    }
}

static void end_element(void *user, const char *element) {
    struct ome *o = user;
    const char *name = plain(element);
    o->depth--;
    if (strcmp(name, "UUID") == 0)
        o->in_uuid = false;
    else if (strcmp(name, "Pixels") == 0)
        o->in_pixels = false;
    else if (o->in_block && strcmp(name, "TiffData") == 0)
        end_block(o);
}

static void append_uuid(void *user, const char *text, int size) {
    struct ome *o = user;
    const size_t used = strlen(o->uuid);
    if (o->in_uuid)
        snprintf(o->uuid + used, sizeof o->uuid - used, "%.*s", size, text);
}

static void start_doctype(void *user, const char *name, const char *system, const char *public,
                          int has_subset) {
    (void)name;
    (void)system;
    (void)public;
    (void)has_subset;
    fail(user, SP_ERR_FORMAT, "the description has a document type, which is not supported");
}

bool tiff_is_ome(const char *description) {
    const char *start = description + strspn(description, " \t\r\n\xef\xbb\xbf");
    const char *ome = strstr(start, "<OME");
    return *start == '<' && ((ome && strchr(" >/\n\r\t", ome[4])) || strstr(start, ":OME "));
}

static bool finish(struct ome *o) {
    struct tiff_planes *p = o->planes;
    if (!p->pages)
        fail(o, SP_ERR_FORMAT, "the description has no element Pixels");
    if (o->failed)
        return false;
    check_times(p);
    compute_distance(o);
    if (!o->has_blocks) { /* all planes are here, in their order */
        o->block = (struct block){ .count = o->pages };
        end_block(o);
    }
    if (o->images > 1)
        import_warn(o->file->warnings, "Only the first of %u images of the file was read.",
                    o->images);
    return !o->failed;
}

bool tiff_ome_parse(struct tiff_planes *planes, const struct import_file *file, const char *xml,
                    size_t size, uint32_t pages, unsigned samples, struct sp_error *err) {
    struct ome o = { .planes = planes,
                     .file = file,
                     .err = err,
                     .pages = pages,
                     .samples = samples ? samples : 1,
                     .parser = XML_ParserCreate(NULL) };
    if (!o.parser)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory");
    XML_SetUserData(o.parser, &o);
    XML_SetElementHandler(o.parser, start_element, end_element);
    XML_SetCharacterDataHandler(o.parser, append_uuid);
    XML_SetStartDoctypeDeclHandler(o.parser, start_doctype);
    if (XML_Parse(o.parser, xml, (int)size, 1) != XML_STATUS_OK)
        fail(&o, SP_ERR_FORMAT, XML_ErrorString(XML_GetErrorCode(o.parser)));
    const bool ok = finish(&o);
    XML_ParserFree(o.parser);
    free(o.heights);
    if (!ok)
        tiff_planes_finish(planes);
    return ok;
}
