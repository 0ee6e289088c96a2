/* SPDX-License-Identifier: Apache-2.0
 *
 * Why this parser is our own: parsers.md.
 */
#include "data/import/zarr_array.h"

#include <ctype.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SHARD_MAX = 1 << 20 }; /* chunks of a shard */

uint64_t zarr_array_chunks(const struct zarr_array *a, unsigned d) {
    return a->shape[d] / a->chunk[d] + (a->shape[d] % a->chunk[d] != 0);
}

/* Numbers and their fill value. */

bool zarr_special_number(const char *text, double *value) {
    static const struct {
        const char *name;
        double value;
    } known[] = { { "NaN", NAN },      { "N", NAN },          { "Infinity", INFINITY },
                  { "Inf", INFINITY }, { "-Inf", -INFINITY }, { "-Infinity", -INFINITY } };
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (strcmp(text, known[i].name) == 0) {
            *value = known[i].value;
            return true;
        }
    return false;
}

/* "0x7fc00000": the bits of a number, the highest first. */
static void fill_from_bits(const char *text, size_t size, uint8_t *out) {
    const uint64_t bits = strtoull(text, NULL, 16);
    for (size_t i = 0; i < size; i++)
        out[__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__ ? size - 1 - i : i] = (uint8_t)(bits >> 8 * i);
}

/* A number in the range of its kind. */
static double in_range(double value, struct import_number number) {
    double low, high;
    if (!import_number_is_whole(number))
        return value;
    import_number_range(number, &low, &high);
    if (number.size == 8) /* the next smaller one of float64 */
        high = nextafter(high, 0);
    return isnan(value) ? 0 : fmin(fmax(value, low), high);
}

static void fill_part(const json_t *json, struct import_number part, uint8_t *out) {
    const char *text = json_string_value(json);
    if (text && strncmp(text, "0x", 2) == 0) {
        fill_from_bits(text + 2, part.size, out);
    } else if (json_is_integer(json) && import_number_is_whole(part)) { /* all 64 bits */
        char bits[24];
        snprintf(bits, sizeof bits, "%" PRIx64, (uint64_t)json_integer_value(json));
        fill_from_bits(bits, part.size, out);
    } else {
        double value = json_is_true(json) ? 1 : json_number_value(json);
        if (text)
            zarr_special_number(text, &value);
        import_narrow(in_range(value, part), part, out);
    }
}

/* The fill value of a complex number is a list of its two parts. */
static void parse_fill(struct zarr_array *a, const json_t *json) {
    const struct import_number part = import_number_part(a->number);
    memset(a->fill, 0, sizeof a->fill);
    fill_part(json_is_array(json) ? json_array_get(json, 0) : json, part, a->fill);
    if (json_is_array(json) && import_number_is_complex(a->number))
        fill_part(json_array_get(json, 1), part, a->fill + part.size);
}

static bool parse_dtype(struct zarr_array *a, const struct zarr_node *node, struct sp_error *err) {
    const char *const key = node->version == 2 ? "dtype" : "data_type";
    const char *text = json_string_value(json_object_get(node->metadata, key));
    char pointer[16];
    bool is_known = false;
    snprintf(pointer, sizeof pointer, "/%s", key);
    if (text && node->version == 2 && strlen(text) >= 3 && strchr("<>|", text[0])) {
        is_known = zarr_number_parse(text, &a->number, &a->is_big_endian);
    } else if (text && node->version == 3) {
        is_known = import_number_named(strcmp(text, "bool") == 0 ? "uint8" : text, &a->number);
    }
    if (!is_known)
        a->number.size = 0;
    return is_known ||
           zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, pointer,
                          "the type %.40s is not supported; supported are bool, integers of 8 to "
                          "64 bits, floating-point numbers of 16, 32 and 64 bits, and complex "
                          "numbers",
                          text ? text : "of a structure");
}

/* Shapes. */

static bool parse_sizes(const struct zarr_node *node, const json_t *json, const char *pointer,
                        uint64_t least, unsigned rank, uint64_t *out, struct sp_error *err) {
    if (json_array_size(json) != rank)
        return zarr_node_fail(node, err, SP_ERR_FORMAT, pointer, "must have %u numbers", rank);
    for (unsigned d = 0; d < rank; d++) {
        const json_t *size = json_array_get(json, d);
        const json_int_t value = json_integer_value(size);
        if (!json_is_integer(size) || value < (json_int_t)least || value > INT64_C(1) << 48)
            return zarr_node_fail(node, err, SP_ERR_FORMAT, pointer,
                                  "number %u must be whole and in [%" PRIu64 ", 2^48]", d, least);
        out[d] = (uint64_t)value;
    }
    return true;
}

static bool parse_shape(struct zarr_array *a, const struct zarr_node *node, struct sp_error *err) {
    const json_t *shape = json_object_get(node->metadata, "shape");
    const size_t rank = json_array_size(shape);
    if (rank < 1 || rank > ZARR_RANK_MAX)
        return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, "/shape",
                              "has %zu dimensions, outside [1, %d]", rank, ZARR_RANK_MAX);
    a->rank = (unsigned)rank;
    for (unsigned d = 0; d < a->rank; d++) {
        a->order[d] = d;
        a->shard[d] = 1;
    }
    return parse_sizes(node, shape, "/shape", 1, a->rank, a->shape, err);
}

/* The names of dimensions are in v3's metadata; xarray writes them into the attributes of v2. */
static void parse_names(struct zarr_array *a, const struct zarr_node *node) {
    const json_t *names = json_object_get(node->metadata, "dimension_names");
    if (!names)
        names = json_object_get(node->attributes, "_ARRAY_DIMENSIONS");
    for (unsigned d = 0; d < a->rank; d++) {
        const char *name = json_string_value(json_array_get(names, d));
        snprintf(a->names[d], sizeof a->names[d], "%s", name ? name : "");
    }
}

static bool check_chunk(struct zarr_array *a, const struct zarr_node *node, const char *pointer,
                        struct sp_error *err) {
    uint64_t bytes = a->number.size;
    for (unsigned d = 0; d < a->rank; d++) {
        if (a->chunk[d] > ZARR_CHUNK_MAX / bytes)
            return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, pointer,
                                  "a chunk has more than %d MiB; write the array with smaller "
                                  "chunks",
                                  ZARR_CHUNK_MAX >> 20);
        bytes *= a->chunk[d];
    }
    a->chunk_bytes = a->number.size;
    for (unsigned d = 0; d < a->rank; d++)
        a->chunk_bytes *= (size_t)a->chunk[d];
    return true;
}

/* Codecs. */

static bool add_codec(struct zarr_array *a, const struct zarr_node *node, const char *name,
                      const json_t *settings, const char *pointer, struct sp_error *err) {
    struct sp_error why;
    struct zarr_step step;
    bool is_nothing;
    if (!zarr_step_parse(&step, name, settings, &is_nothing, &why))
        return zarr_node_fail(node, err, why.code, pointer, "%s", why.text);
    if (a->codec_count == ZARR_CODECS_MAX)
        return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, pointer, "has more than %d codecs",
                              ZARR_CODECS_MAX);
    if (!is_nothing)
        a->codecs[a->codec_count++] = step;
    return true;
}

static bool parse_v2(struct zarr_array *a, const struct zarr_node *node, struct sp_error *err) {
    const json_t *metadata = node->metadata, *compressor = json_object_get(metadata, "compressor");
    const json_t *filters = json_object_get(metadata, "filters"), *filter;
    size_t i;
    const char *order = json_string_value(json_object_get(metadata, "order"));
    const char *separator = json_string_value(json_object_get(metadata, "dimension_separator"));
    a->separator = separator && strcmp(separator, "/") == 0 ? '/' : '.';
    for (unsigned d = 0; order && order[0] == 'F' && d < a->rank; d++)
        a->order[d] = a->rank - 1 - d;
    parse_fill(a, json_object_get(metadata, "fill_value"));
    json_array_foreach(filters, i,
                       filter) if (!add_codec(a, node,
                                              json_string_value(json_object_get(filter, "id")),
                                              filter, "/filters", err)) return false;
    if (json_is_object(compressor) &&
        !add_codec(a, node, json_string_value(json_object_get(compressor, "id")), compressor,
                   "/compressor/id", err))
        return false;
    return parse_sizes(node, json_object_get(metadata, "chunks"), "/chunks", 1, a->rank, a->chunk,
                       err) &&
           check_chunk(a, node, "/chunks", err);
}

/* Parses a transposition. One after another is of the dimensions that the first one has made. */
static bool parse_order(struct zarr_array *a, const struct zarr_node *node, const json_t *order,
                        struct sp_error *err) {
    unsigned seen = 0, before[ZARR_RANK_MAX];
    memcpy(before, a->order, sizeof before);
    for (unsigned d = 0; d < a->rank; d++) {
        const json_int_t of = json_integer_value(json_array_get(order, d));
        if (of < 0 || of >= (json_int_t)a->rank || !json_is_integer(json_array_get(order, d)))
            break;
        a->order[d] = before[of];
        seen |= 1U << of;
    }
    return seen == (1U << a->rank) - 1 ||
           zarr_node_fail(node, err, SP_ERR_FORMAT, "/codecs",
                          "the order of \"transpose\" is not one of %u dimensions", a->rank);
}

static bool parse_shards(struct zarr_array *a, const struct zarr_node *node, const json_t *settings,
                         struct sp_error *err) {
    uint64_t inner[ZARR_RANK_MAX], count = 1;
    const char *at = json_string_value(json_object_get(settings, "index_location"));
    const json_t *codec;
    size_t i;
    if (!parse_sizes(node, json_object_get(settings, "chunk_shape"), "/codecs/sharding_indexed", 1,
                     a->rank, inner, err))
        return false;
    for (unsigned d = 0; d < a->rank; d++) {
        if (a->chunk[d] % inner[d] != 0)
            return zarr_node_fail(node, err, SP_ERR_FORMAT, "/codecs/sharding_indexed",
                                  "dimension %u of a shard is no multiple of that of its chunks",
                                  d);
        a->shard[d] = a->chunk[d] / inner[d];
        a->chunk[d] = inner[d];
        if (a->shard[d] > SHARD_MAX / count)
            return zarr_node_fail(
                node, err, SP_ERR_UNSUPPORTED, "/codecs/sharding_indexed",
                "a shard has more than %d chunks, the limit; write smaller shards", SHARD_MAX);
        count *= a->shard[d];
    }
    a->is_sharded = true;
    a->is_index_first = at && strcmp(at, "start") == 0;
    json_array_foreach(json_object_get(settings, "index_codecs"), i, codec) {
        const char *name = json_string_value(json_object_get(codec, "name"));
        if (name && strcmp(name, "crc32c") == 0)
            a->has_index_checksum = true;
        else if (!name || strcmp(name, "bytes") != 0)
            return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, "/codecs/sharding_indexed",
                                  "the codec \"%.40s\" of the index is not supported",
                                  name ? name : "?");
    }
    return true;
}

/* The codecs of v3: an optional transposition, "bytes", then compressors; or a shard with such
 * codecs inside. */
static bool parse_codecs(struct zarr_array *a, const struct zarr_node *node, const json_t *codecs,
                         struct sp_error *err) {
    const json_t *codec;
    bool has_bytes = false;
    unsigned filters = 0;
    size_t i;
    json_array_foreach(codecs, i, codec) {
        const char *name = json_string_value(json_object_get(codec, "name"));
        const json_t *settings = json_object_get(codec, "configuration");
        if (name && !has_bytes && a->codec_count == 0 && strcmp(name, "transpose") == 0) {
            if (!parse_order(a, node, json_object_get(settings, "order"), err))
                return false;
        } else if (name && !has_bytes && strcmp(name, "bytes") == 0) {
            const char *endian = json_string_value(json_object_get(settings, "endian"));
            a->is_big_endian = endian && strcmp(endian, "big") == 0;
            has_bytes = true;
        } else if (name && i == 0 && json_array_size(codecs) == 1 && !a->is_sharded &&
                   strcmp(name, "sharding_indexed") == 0) {
            return parse_shards(a, node, settings, err) &&
                   parse_codecs(a, node, json_object_get(settings, "codecs"), err);
        } else if (!has_bytes && name && strncmp(name, "numcodecs.", 10) == 0) { /* a filter */
            if (!add_codec(a, node, name, settings, "/codecs", err))
                return false;
            filters++;
        } else if (!has_bytes) {
            return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, "/codecs",
                                  "the codec \"%.40s\" is not supported after the codecs before it",
                                  name ? name : "?");
        } else if (!add_codec(a, node, name, settings, "/codecs", err)) {
            return false;
        }
    }
    if (filters > 0 && a->is_big_endian)
        return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, "/codecs",
                              "filters of big-endian numbers are not supported; write them with "
                              "the lowest byte first");
    return has_bytes ||
           zarr_node_fail(node, err, SP_ERR_FORMAT, "/codecs", "the codec \"bytes\" is missing");
}

static bool parse_v3(struct zarr_array *a, const struct zarr_node *node, struct sp_error *err) {
    const json_t *grid = json_object_get(node->metadata, "chunk_grid");
    const json_t *keys = json_object_get(node->metadata, "chunk_key_encoding");
    const json_t *settings = json_object_get(keys, "configuration");
    const char *grid_name = json_string_value(json_object_get(grid, "name"));
    const char *key_name = json_string_value(json_object_get(keys, "name"));
    const char *separator = json_string_value(json_object_get(settings, "separator"));
    if (!grid_name || strcmp(grid_name, "regular") != 0)
        return zarr_node_fail(
            node, err, SP_ERR_UNSUPPORTED, "/chunk_grid/name",
            "the chunk grid must be \"regular\"; write the array with chunks of one size");
    a->has_prefix = !key_name || strcmp(key_name, "v2") != 0;
    a->separator = separator && separator[0] == '.'   ? '.'
                   : separator && separator[0] == '/' ? '/'
                   : a->has_prefix                    ? '/'
                                                      : '.';
    parse_fill(a, json_object_get(node->metadata, "fill_value"));
    if (json_array_size(json_object_get(node->metadata, "storage_transformers")) > 0)
        return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, "/storage_transformers",
                              "storage transformers are not supported; write the array "
                              "without them");
    return parse_sizes(node, json_object_get(json_object_get(grid, "configuration"), "chunk_shape"),
                       "/chunk_grid/configuration/chunk_shape", 1, a->rank, a->chunk, err) &&
           parse_codecs(a, node, json_object_get(node->metadata, "codecs"), err) &&
           check_chunk(a, node, "/chunk_grid/configuration/chunk_shape", err);
}

bool zarr_array_parse(struct zarr_array *a, const struct zarr_node *node, struct sp_error *err) {
    *a = (struct zarr_array){ .rank = 0 };
    snprintf(a->path, sizeof a->path, "%s", node->path);
    if (!parse_shape(a, node, err) || !parse_dtype(a, node, err))
        return false;
    parse_names(a, node);
    return node->version == 2 ? parse_v2(a, node, err) : parse_v3(a, node, err);
}
