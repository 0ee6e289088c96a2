/* SPDX-License-Identifier: Apache-2.0
 *
 * Shared by the out-of-memory tests: the daemon in this process, with one admin token and one
 * render token, a client on a socket, and checks that hold for every answer.
 */
#ifndef TESTS_OOM_H
#define TESTS_OOM_H

#include <stdbool.h>
#include <stddef.h>

#define OOM_ADMIN "admin-0123456789abcdef"
#define OOM_GALLERY "gallery-0123456789abcdef" /* has the role "render" */

/* Fixture of the group. The volume "engine" may still be loading. */
int oom_set_up(void **state);
int oom_tear_down(void **state);

struct oom_client {
    int fd;
    size_t have;
    char bytes[1 << 18]; /* bytes received and not used yet, then a NUL */
};
extern struct oom_client oom_http; /* used by oom_ask(); its bytes are the last answer */
#define OOM_JSON "application/json"
extern const char *oom_type;  /* Content-Type of the requests of oom_ask(); initially OOM_JSON */
extern const char *oom_token; /* sent by oom_ask(); initially OOM_ADMIN */
extern char oom_session[64],
    oom_saved_view[64]; /* ids of a session and a saved view that exist during all tests */

void oom_connect(struct oom_client *client);
void oom_hang_up(struct oom_client *client);
void oom_send(struct oom_client *client, const void *bytes, size_t size);
/* Waits for bytes. Returns false if the daemon has closed the connection. */
bool oom_receive(struct oom_client *client);

/* Sends a request, after which the daemon closes the connection. A path without a leading slash is
 * below /api/v1/. */
void oom_request(const char *method, const char *path, const char *body);
/* Sends a request. Returns the status of its answer; 0 = the connection ended before the answer was
 * complete. */
int oom_ask(const char *method, const char *path, const char *body);
/* The same; fails unless the status is `expected`. */
void oom_must(const char *method, const char *path, const char *body, int expected);
/* Copies the text after the first `"key":"` of the last answer. */
void oom_member(const char *key, char value[64]);

/* True if the daemon answers with this status when it has no memory. */
bool oom_is_no_memory(int status);
/* Sends a request while the next place of an allocation fails (memory_fail_at_place). Returns false
 * if no allocation failed. Fails the test unless the status is `expected` or, when an allocation
 * failed, oom_is_no_memory(). */
bool oom_try(const char *method, const char *path, const char *body, int expected, int *status);
/* Repeats oom_try() until no allocation fails. `body` may have one %ld, so that each request
 * creates something new. Fails the test unless a GET that succeeds gives the same answer as with
 * enough memory, numbers aside; a request that fails with 5xx creates nothing; and the daemon
 * accepts a request that failed when it is sent again. */
void oom_each_allocation(const char *method, const char *path, const char *body, int expected);

/* Marks the operation of openapi.yaml with this method and path as covered. */
void oom_cover(const char *method, const char *path);
/* Fails unless each operation of openapi.yaml is covered. */
void oom_all_is_covered(void **state);

void oom_paths(void **state);   /* oom_paths.c */
void oom_streams(void **state); /* oom_streams.c */

#endif
