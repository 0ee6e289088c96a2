/* SPDX-License-Identifier: Apache-2.0 */
#include "support/fake_memory.h"

#include <dirent.h>
#include <errno.h>
#include <execinfo.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static _Thread_local bool is_spared;
static atomic_long left = -1; /* allocations until one fails; < 0 = none fails */
static atomic_bool stays_out, has_failed, fails_at_place;
static atomic_size_t largest;

void memory_fail_after(long n, enum memory_end end) {
    atomic_store(&stays_out, end == MEMORY_STAYS_OUT);
    atomic_store(&has_failed, false);
    atomic_store(&left, n);
}

bool memory_restore(void) {
    atomic_store(&left, -1);
    atomic_store(&fails_at_place, false);
    return atomic_load(&has_failed);
}

/* Places of allocations: an open hash table. `calls` is 0 in free slots. */
enum { PLACES = 1 << 14, PLACE_FAILURES = 2 };
static struct place {
    uint64_t calls; /* hash of the return addresses */
    unsigned failures;
} places[PLACES];
static long reached,
    examined; /* allocations of this try; of all tries since the places are known */
static pthread_mutex_t places_lock = PTHREAD_MUTEX_INITIALIZER;

void memory_fail_at_place(void) {
    memory_restore();
    reached = 0;
    atomic_store(&has_failed, false);
    atomic_store(&fails_at_place, true);
}

void memory_forget_places(void) {
    pthread_mutex_lock(&places_lock);
    memset(places, 0, sizeof places);
    examined = 0;
    pthread_mutex_unlock(&places_lock);
}

static struct place *find_place(void) {
    enum { OWN = 2 }; /* calls of this file, at most */
    void *calls[MEMORY_PLACE_CALLS + OWN];
    uint64_t hash = 1;
    for (int i = backtrace(calls, MEMORY_PLACE_CALLS + OWN); i-- > 0;)
        hash = (hash ^ (uintptr_t)calls[i]) * UINT64_C(0x9e3779b97f4a7c15);
    hash |= 1;
    size_t i = hash >> 32 & (PLACES - 1);
    while (places[i].calls && places[i].calls != hash)
        i = (i + 1) & (PLACES - 1);
    places[i].calls = hash;
    return &places[i];
}

/* True once after memory_fail_at_place(). */
static bool place_fails(void) {
    bool fails = false;
    pthread_mutex_lock(&places_lock);
    if (atomic_load(&fails_at_place) && ++reached > examined) {
        struct place *place = find_place();
        examined = reached;
        fails = place->failures < PLACE_FAILURES;
        place->failures += fails;
    }
    if (fails) {
        atomic_store(&fails_at_place, false);
        atomic_store(&has_failed, true);
    }
    pthread_mutex_unlock(&places_lock);
    return fails;
}

void memory_exempt_thread(bool spared) {
    is_spared = spared;
}

size_t memory_consume_largest(void) {
    return atomic_exchange(&largest, 0);
}

static void note_size(size_t size) {
    size_t known = atomic_load(&largest);
    while (known < size && !atomic_compare_exchange_weak(&largest, &known, size))
        ;
}

bool memory_is_available(void) {
    long n = atomic_load(&left);
    if (is_spared)
        return true;
    if (atomic_load(&fails_at_place))
        return !place_fails();
    while (n > 0 || (n == 0 && !atomic_load(&stays_out)))
        if (atomic_compare_exchange_weak(&left, &n, n - 1))
            break;
    if (n != 0)
        return true;
    atomic_store(&has_failed, true);
    return false;
}

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *old, size_t size);
void *__real_aligned_alloc(size_t alignment, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *old, size_t size);
void *__wrap_aligned_alloc(size_t alignment, size_t size);

void *__wrap_malloc(size_t size) {
    note_size(size);
    return memory_is_available() ? __real_malloc(size) : NULL;
}

void *__wrap_calloc(size_t count, size_t size) {
    note_size(count * size);
    return memory_is_available() ? __real_calloc(count, size) : NULL;
}

void *__wrap_realloc(void *old, size_t size) {
    note_size(size);
    return memory_is_available() ? __real_realloc(old, size) : NULL;
}

void *__wrap_aligned_alloc(size_t alignment, size_t size) {
    note_size(size);
    return memory_is_available() ? __real_aligned_alloc(alignment, size) : NULL;
}

/* Functions of the C library that allocate. Hardened builds call the names that end in _chk. */

char *__real_strdup(const char *text);
char *__real_strndup(const char *text, size_t most);
char *__real_realpath(const char *path, char *resolved);
char *__wrap_strdup(const char *text);
char *__wrap_strndup(const char *text, size_t most);
char *__wrap_realpath(const char *path, char *resolved);
char *__wrap___realpath_chk(const char *path, char *resolved, size_t size);
int __wrap_asprintf(char **text, const char *format, ...);
int __wrap___asprintf_chk(char **text, int flag, const char *format, ...);

char *__wrap_strdup(const char *text) {
    return memory_is_available() ? __real_strdup(text) : NULL;
}

char *__wrap_strndup(const char *text, size_t most) {
    return memory_is_available() ? __real_strndup(text, most) : NULL;
}

char *__wrap_realpath(const char *path, char *resolved) {
    if (resolved || memory_is_available())
        return __real_realpath(path, resolved);
    errno = ENOMEM;
    return NULL;
}

char *__wrap___realpath_chk(const char *path, char *resolved, size_t size) {
    (void)size;
    return __wrap_realpath(path, resolved);
}

__attribute__((format(printf, 2, 0))) static int print(char **text, const char *format,
                                                       va_list args) {
    return memory_is_available() ? vasprintf(text, format, args) : -1;
}

int __wrap_asprintf(char **text, const char *format, ...) {
    va_list args;
    va_start(args, format);
    int size = print(text, format, args);
    va_end(args);
    return size;
}

int __wrap___asprintf_chk(char **text, int flag, const char *format, ...) {
    (void)flag;
    va_list args;
    va_start(args, format);
    int size = print(text, format, args);
    va_end(args);
    return size;
}

FILE *__real_fopen(const char *path, const char *mode);
DIR *__real_opendir(const char *path);
DIR *__real_fdopendir(int fd);
FILE *__wrap_fopen(const char *path, const char *mode);
DIR *__wrap_opendir(const char *path);
DIR *__wrap_fdopendir(int fd);
FILE *__wrap_open_memstream(char **text, size_t *size);

static void *no_memory(void) {
    errno = ENOMEM;
    return NULL;
}

FILE *__wrap_fopen(const char *path, const char *mode) {
    return memory_is_available() ? __real_fopen(path, mode) : no_memory();
}

DIR *__wrap_opendir(const char *path) {
    return memory_is_available() ? __real_opendir(path) : no_memory();
}

DIR *__wrap_fdopendir(int fd) {
    return memory_is_available() ? __real_fdopendir(fd) : no_memory();
}

struct stream { /* of open_memstream() */
    char **text;
    size_t *size;
};

/* Grows the buffer of an open_memstream(). Returns 0, a write error, if memory runs out. */
static ssize_t write_stream(void *user, const char *bytes, size_t size) {
    struct stream *stream = user;
    char *text = realloc(*stream->text, *stream->size + size + 1);
    if (!text)
        return 0;
    memcpy(text + *stream->size, bytes, size);
    *stream->text = text;
    *stream->size += size;
    text[*stream->size] = 0;
    return (ssize_t)size;
}

static int close_stream(void *user) {
    free(user);
    return 0;
}

FILE *__wrap_open_memstream(char **text, size_t *size) {
    struct stream *stream = malloc(sizeof *stream);
    const cookie_io_functions_t functions = { .write = write_stream, .close = close_stream };
    if (!stream)
        return no_memory();
    *stream = (struct stream){ text, size };
    *text = NULL;
    *size = 0;
    return fopencookie(stream, "w", functions);
}
