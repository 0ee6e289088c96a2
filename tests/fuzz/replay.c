/* SPDX-License-Identifier: Apache-2.0
 *
 * Runs the files of a folder through a fuzz target, for builds without libFuzzer. A crash or a
 * finding of a sanitizer fails the test, and so does an empty or missing folder.
 */
#include <dirent.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static int replay(const char *path) {
    FILE *file = fopen(path, "rb");
    if (!file) {
        perror(path);
        return -1;
    }
    size_t capacity = 1 << 20;
    uint8_t *buffer = malloc(capacity);
    size_t size = buffer ? fread(buffer, 1, capacity, file) : 0;
    fclose(file);
    /* An allocation of the exact size, so that a read past the end is found. */
    uint8_t *exact = buffer ? realloc(buffer, size ? size : 1) : NULL;
    if (exact)
        LLVMFuzzerTestOneInput(exact, size);
    free(exact);
    return exact ? 0 : -1;
}

int main(int argc, char **argv) {
    DIR *folder = argc == 2 ? opendir(argv[1]) : NULL;
    if (!folder) {
        fprintf(stderr, "usage: %s FOLDER (which must exist)\n", argv[0]);
        return 2;
    }
    int count = 0, failed = 0;
    for (const struct dirent *entry; (entry = readdir(folder));) {
        char path[4096];
        if (entry->d_name[0] == '.')
            continue;
        snprintf(path, sizeof path, "%s/%s", argv[1], entry->d_name);
        failed += replay(path) != 0;
        count++;
    }
    closedir(folder);
    printf("%d inputs of %s replayed\n", count, argv[1]);
    return count > 0 && failed == 0 ? 0 : 1;
}
