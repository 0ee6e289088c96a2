/* SPDX-License-Identifier: Apache-2.0 */
#include "support/data.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

const char *test_data_folder(const char *configured) {
    const char *folder = getenv("SPLATD_DATA_DIR");
    return folder && *folder ? folder : configured;
}

bool test_data_path(const char *configured, const char *file, char *path, size_t size) {
    static const char *const below[] = { "", "volumes/" };
    const char *folder = test_data_folder(configured);
    for (size_t i = 0; i < sizeof below / sizeof *below; i++) {
        snprintf(path, size, "%s/%s%s", folder, below[i], file);
        if (!access(path, R_OK))
            return true;
    }
    printf("skipped: %s is not in %s (set SPLATD_DATA_DIR to the folder of the real volumes)\n",
           file, folder);
    return false;
}
