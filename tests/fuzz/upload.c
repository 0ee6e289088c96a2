/* SPDX-License-Identifier: Apache-2.0
 *
 * What a client says about an upload: the headers of tus, the name of the file, and the first bytes
 * of a file. The first byte of the input chooses.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "http/upload_headers.h"
#include "protocol/text.h"
#include "render/formats.h"
#include "render/source.h"
#include "sp/volume.h"
#include "uploads/uploads.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void must(bool holds) {
    if (!holds)
        abort();
}

static void check_header(const char *text) {
    static const char *const keys[] = { "filename", "name", "type" };
    unsigned char digest[SRV_DIGEST_BYTES] = { 0 };
    char value[SRV_METADATA_BYTES];
    size_t length;
    uint64_t number;
    int algorithm;
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        if (srv_upload_metadata(text, keys[i], value, &length))
            must(length < sizeof value && strlen(value) == length);
    if (srv_upload_number(text, &number))
        must(number <= UINT64_C(1) << 53);
    if (srv_checksum_parse(text, &algorithm, digest)) {
        struct srv_checksum *checksum = srv_checksum_create(algorithm, digest);
        must(checksum != NULL);
        srv_checksum_add(checksum, text, strlen(text));
        srv_checksum_matches(&checksum);
        must(checksum == NULL);
    }
}

static void check_name(const char *text, size_t size) {
    char name[SRV_UPLOAD_NAME_BYTES], id[SP_NAME_BYTES];
    if (!srv_upload_name(text, size, name, NULL))
        return;
    must(strlen(name) < sizeof name && !strchr(name, '/') && !strchr(name, '\\'));
    must(name[0] && strcmp(name, ".") != 0 && strcmp(name, "..") != 0 && proto_text_is_plain(name));
    srv_source_default_id(name, id);
    must(srv_source_is_id(id));
    srv_source_default_name(name, id);
    must(strlen(id) < sizeof id);
    must(srv_format_of(name) || !srv_format_extension(name)); /* folders have no extension */
    must(srv_format_stem(name) <= strlen(name));
}

static void check_beginning(const char *bytes, size_t size) {
    static const char *const names[] = { "a.nrrd", "a.vtk", "a.vti", "a.json", "a.tif", "a.ply" };
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        struct srv_format_peek peek;
        srv_format_look(names[i], bytes, size, &peek);
        must(peek.kind <= SP_KIND_COUNT);
        if (peek.dims[0])
            for (int axis = 0; axis < 3; axis++)
                must(peek.dims[axis] >= 1 && peek.dims[axis] <= SP_DIM_MAX);
        must(strlen(peek.type) < sizeof peek.type);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 1)
        return 0;
    char *text = malloc(size);
    must(text != NULL);
    memcpy(text, data + 1, size - 1);
    text[size - 1] = 0;
    if (data[0] == 'h')
        check_header(text);
    else if (data[0] == 'n')
        check_name(text, size - 1);
    else
        check_beginning(text, size - 1);
    free(text);
    return 0;
}
