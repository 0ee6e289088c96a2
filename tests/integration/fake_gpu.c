/* SPDX-License-Identifier: Apache-2.0
 *
 * A daemon with a fake GPU: the linker replaces the registry's table by the table below (--wrap).
 * The fake GPU renders like the CPU, two frames at a time, until a signal: after SIGUSR1 every
 * frame fails, after SIGUSR2 every frame lacks memory. A line on standard error reports the change.
 */
#include <errno.h>
#include <signal.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

#include "backend/backend.h"

enum { DRAWS, HANGS, IS_FULL };
static atomic_int condition = DRAWS; /* set by a signal, read by render threads */

const struct sp_backend *__real_sp_registry_at(unsigned i);
const struct sp_backend *__wrap_sp_registry_at(unsigned i);

static void on_signal(int number) {
    static const char hangs[] = "the GPU hangs\n", is_full[] = "the GPU is full\n";
    int before = errno;
    condition = number == SIGUSR1 ? HANGS : IS_FULL;
    ssize_t written = number == SIGUSR1 ? write(STDERR_FILENO, hangs, sizeof hangs - 1)
                                        : write(STDERR_FILENO, is_full, sizeof is_full - 1);
    (void)written;
    errno = before;
}

static const struct sp_backend *find_cpu(void) {
    for (unsigned i = 0; __real_sp_registry_at(i); i++)
        if (strcmp(__real_sp_registry_at(i)->entry.name, "cpu") == 0)
            return __real_sp_registry_at(i);
    return NULL;
}

static void *create(const struct sp_backend_options *options, struct sp_error *err) {
    const struct sigaction action = { .sa_handler = on_signal, .sa_flags = SA_RESTART };
    sigaction(SIGUSR1, &action, NULL);
    sigaction(SIGUSR2, &action, NULL);
    void *state = find_cpu()->create(options, err);
    if (!state || !options->passes || options->passes(options->user, state, err))
        return state;
    find_cpu()->destroy(state);
    return NULL;
}

static void destroy(void *state) {
    find_cpu()->destroy(state);
}

static void info(const void *state, struct sp_renderer_info *to) {
    find_cpu()->info(state, to);
    to->backend = "fake";
}

static bool begin(void *state, const struct sp_backend_job *job, struct sp_error *err) {
    (void)state, (void)job, (void)err;
    return true;
}

static bool finish(void *state, const struct sp_backend_job *job, struct sp_error *err) {
    if (condition == HANGS)
        return sp_fail(err, SP_ERR_BACKEND, "", "the GPU hangs");
    if (condition == IS_FULL)
        return sp_fail(err, SP_ERR_BUDGET, "", "it takes 7 bytes and 3 are allowed");
    return find_cpu()->render(state, job, err);
}

static void evict(void *state, const struct sp_volume *volume) {
    find_cpu()->evict(state, volume);
}

static uint64_t memory(const void *state, const struct sp_volume *volume) {
    return find_cpu()->memory(state, volume);
}

const struct sp_backend *__wrap_sp_registry_at(unsigned i) {
    static struct sp_backend fake = { .entry = { "fake", "a GPU for tests" },
                                      .is_gpu = true,
                                      .create = create,
                                      .destroy = destroy,
                                      .info = info,
                                      .render = finish,
                                      .depth = 2,
                                      .begin = begin,
                                      .finish = finish,
                                      .evict = evict,
                                      .memory = memory };
    static const struct sp_backend *table[2];
    if (!table[0]) { /* no lock: the first renderer is created before other threads */
        fake.capabilities = find_cpu()->capabilities;
        table[1] = find_cpu();
        table[0] = &fake;
    }
    return i < 2 ? table[i] : NULL;
}
