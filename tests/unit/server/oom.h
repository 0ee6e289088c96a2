/* SPDX-License-Identifier: Apache-2.0
 *
 * What the tests of memory that runs out share: the daemon in this process, with a token for
 * everything and one that draws, a client on a socket, and what holds of each answer.
 */
#ifndef TESTS_OOM_H
#define TESTS_OOM_H

#include <stdbool.h>
#include <stddef.h>

#define OOM_ADMIN "admin-0123456789abcdef"
#define OOM_GALLERY "gallery-0123456789abcdef" /* of the role "render" */

/* Fixture of the group. The volume "engine" may still be loading. */
int oom_set_up(void **state);
int oom_tear_down(void **state);

struct oom_client {
    int fd;
    size_t have;
    char bytes[1 << 17]; /* that came and were not used, with a NUL behind them */
};
extern struct oom_client oom_http;         /* of oom_ask(); its bytes are the last answer */
extern const char *oom_token;              /* that oom_ask() gives; at first OOM_ADMIN */
extern char oom_session[64], oom_kept[64]; /* ids of what is there during all tests */

void oom_dial(struct oom_client *client);
void oom_hang_up(struct oom_client *client);
void oom_tell(struct oom_client *client, const void *bytes, size_t size);
/* False: the other side has closed. */
bool oom_hear(struct oom_client *client);

/* Sends a request whose answer is the last one. A path without a slash lies below /api/v1/. */
void oom_request(const char *method, const char *path, const char *body);
/* The status of the answer; 0 = the connection ended before it did. */
int oom_ask(const char *method, const char *path, const char *body);
/* The answer has that status, and what it promises is on the disk. */
void oom_must(const char *method, const char *path, const char *body, int expected);
/* The text behind the first `"key":"` of the last answer. */
void oom_member(const char *key, char value[64]);

/* Is that what is answered when there was no memory? */
bool oom_is_told(int status);
/* Asks while the n-th allocation fails; false: none did. The status is `expected`, or told. */
bool oom_try(long n, const char *method, const char *path, const char *body, int expected,
             int *status);
/* The same for every n until nothing fails. `body` may have one %ld, so that nothing is there
 * already. An answer of 200 is like one with memory; who is refused has made nothing; and the next
 * request is answered as ever. */
void oom_each_allocation(const char *method, const char *path, const char *body, int expected);

/* A request of this method and path is covered: marks its operation of openapi.yaml. */
void oom_cover(const char *method, const char *path);
/* Each operation of openapi.yaml was covered. */
void oom_all_is_covered(void **state);

void oom_paths(void **state);   /* oom_paths.c */
void oom_streams(void **state); /* oom_streams.c */

#endif
