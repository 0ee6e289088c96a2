/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/input.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "data/import/address.h"
#include "data/import/confine.h"
#include "data/import/remote.h"
#include "sp/volume.h"

bool sp_import_check_host(const char *address, const char *allowed, struct sp_error *err) {
    struct sp_address parts;
    if (!sp_address_parse(address, &parts, err))
        return false;
    return sp_address_allowed(&parts, allowed) != SP_NOT_ALLOWED ||
           sp_fail(
               err, SP_ERR_DENIED, address,
               "the host %.200s, port %u, is not allowed; --allow-host lists the hosts that are",
               parts.host, parts.port);
}

/* Copies a source without what follows '?'. */
static bool copy_address(const char *source, char address[SP_ADDRESS_BYTES], struct sp_error *err) {
    const size_t length = sp_source_split(source).path_bytes;
    if (length >= SP_ADDRESS_BYTES)
        return sp_fail(err, SP_ERR_INVALID, source, "the address has %zu bytes; the limit is %d",
                       length, SP_ADDRESS_BYTES - 1);
    memcpy(address, source, length);
    address[length] = 0;
    return true;
}

bool sp_source_check_host(const char *source, const char *allowed, struct sp_error *err) {
    char address[SP_ADDRESS_BYTES];
    return copy_address(source, address, err) && sp_import_check_host(address, allowed, err);
}

bool sp_source_host(const char *source, char host[SP_SOURCE_HOST_BYTES], struct sp_error *err) {
    char address[SP_ADDRESS_BYTES];
    struct sp_address parts;
    host[0] = 0;
    if (!sp_address_is_remote(source))
        return true;
    if (!copy_address(source, address, err) || !sp_address_parse(address, &parts, err))
        return false;
    if (parts.port == 80 || parts.port == 443)
        snprintf(host, SP_SOURCE_HOST_BYTES, "%s", parts.host);
    else
        snprintf(host, SP_SOURCE_HOST_BYTES, "%s:%u", parts.host, parts.port);
    return true;
}

bool sp_hosts_check(const char *allowed, struct sp_error *err) {
    return sp_address_check_list(allowed, NULL, err);
}

bool sp_source_is_remote(const char *source) {
    return sp_address_is_remote(source);
}

static bool find_fetcher(const char *importer, char path[PATH_MAX], struct sp_error *err) {
    const char *slash = strrchr(importer, '/');
    const int folder = slash ? (int)(slash - importer) : 1;
    if (snprintf(path, PATH_MAX, "%.*s/splat-fetch", folder, slash ? importer : ".") < PATH_MAX &&
        access(path, X_OK) == 0)
        return true;
    return sp_fail(err, SP_ERR_UNSUPPORTED, path,
                   "this installation cannot fetch remote volumes: it was built without libcurl");
}

static bool start_fetcher(struct sp_import_input *input, const struct sp_import_place *place,
                          const char *importer, const char *allowed, struct sp_error *err) {
    char name[] = "splat-fetch", program[PATH_MAX];
    char *argv[] = { name, (char *)place->path, (char *)allowed, NULL };
    struct sp_import_child *c = &input->fetch;
    if (!sp_import_check_host(place->path, allowed, err) || !find_fetcher(importer, program, err))
        return false;
    c->title = place->path;
    if (!sp_import_child_start(c, program, argv, NULL, NULL, 0, err))
        return false;
    if (ftruncate(c->memory, REMOTE_BUFFER) != 0 ||
        fcntl(c->memory, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW) != 0)
        return sp_fail(err, SP_ERR_MEMORY, place->path, "cannot share memory: %s", strerror(errno));
    input->fds[0] = c->socket;
    input->fds[1] = c->memory;
    input->count = 2;
    c->socket = c->memory = -1;
    return true;
}

bool sp_import_input_open(struct sp_import_input *input, const struct sp_import_place *place,
                          const char *importer, const char *allowed, struct sp_error *err) {
    uint64_t size;
    *input = (struct sp_import_input){ .fds = { -1, -1 }, .fetch = { .socket = -1, .memory = -1 } };
    if (place->is_remote) {
        snprintf(input->folder, sizeof input->folder, "%s", place->root);
        return start_fetcher(input, place, importer, allowed, err);
    }
    if (place->is_folder) {
        input->fds[0] =
            sp_open_confined_folder(place->root, place->file, place->path, input->folder, err);
        input->count = 1;
        return input->fds[0] >= 0;
    }
    input->fds[0] =
        sp_open_confined(place->root, place->file, place->path, input->folder, &size, err);
    input->count = 1;
    if (input->fds[0] < 0)
        return false;
    char *slash = strrchr(input->folder, '/');
    slash[slash == input->folder] = 0;
    return true;
}

void sp_import_input_hand_over(struct sp_import_input *input) {
    for (int i = 0; i < 2; i++) {
        if (input->fds[i] >= 0)
            close(input->fds[i]);
        input->fds[i] = -1;
    }
}

void sp_import_input_close(struct sp_import_input *input) {
    sp_import_input_hand_over(input);
    sp_import_child_close(&input->fetch);
}
