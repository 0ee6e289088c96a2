/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_HELP_H
#define CLI_HELP_H

/* Prints the help of one command, or of all if `command` is NULL or unknown. */
void help_print(const char *command);

#endif
