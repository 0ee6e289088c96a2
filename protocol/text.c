/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/text.h"

#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* Ranges of hidden characters, rising. */
static const uint32_t hidden[][2] = {
    { 0x0001, 0x001F }, { 0x007F, 0x009F }, { 0x00AD, 0x00AD }, { 0x061C, 0x061C },
    { 0x180E, 0x180E }, { 0x200B, 0x200B }, { 0x200E, 0x200F }, { 0x2028, 0x202E },
    { 0x2060, 0x206F }, { 0xFEFF, 0xFEFF }, { 0xFFF9, 0xFFFB }, { 0xE0000, 0xE007F },
};

/* Reads one character and its length; a byte that begins none counts as a character. */
static uint32_t read_character(const unsigned char *c, size_t *length) {
    size_t more = *c >= 0xF0 ? 3 : *c >= 0xE0 ? 2 : *c >= 0xC0 ? 1 : 0;
    uint32_t character = more ? *c & (0x3Fu >> more) : *c;
    *length = 1;
    for (; *length <= more; ++*length) {
        if ((c[*length] & 0xC0) != 0x80)
            return 0xFFFD;
        character = character << 6 | (c[*length] & 0x3Fu);
    }
    return *c >= 0x80 && *c < 0xC0 ? 0xFFFD : character;
}

static bool is_hidden(uint32_t character) {
    for (size_t i = 0; i < sizeof hidden / sizeof *hidden; i++)
        if (character >= hidden[i][0] && character <= hidden[i][1])
            return true;
    return false;
}

bool proto_text_is_plain(const char *text) {
    size_t length;
    for (const unsigned char *c = (const unsigned char *)text; *c; c += length)
        if (is_hidden(read_character(c, &length)))
            return false;
    return true;
}

void proto_text_clean(char *text) {
    unsigned char *out = (unsigned char *)text;
    size_t length;
    for (const unsigned char *c = out; *c; c += length) {
        if (is_hidden(read_character(c, &length)))
            *out++ = ' ';
        else
            for (size_t i = 0; i < length; i++)
                *out++ = c[i];
    }
    *out = 0;
}

/* The letters below the accents of U+00C0 to U+017F, in lower case; '.' = no letter with an
 * accent. */
static const char bases[] = "aaaaaa.ceeeeiiii.nooooo..uuuuy.."
                            "aaaaaa.ceeeeiiii.nooooo..uuuuy.y"
                            "aaaaaaccccccccdd..eeeeeeeeeegggg"
                            "gggghh..iiiiiiiii...jjkk.llllll."
                            "...nnnnnn...oooooo..rrrrrrssssss"
                            "sstttt..uuuuuuuuuuuuwwyyyzzzzzz.";
enum { BASES_FIRST = 0xC0, BASES_COUNT = sizeof bases - 1 };

/* Capital letters: every `step`-th character of a range has its small letter `offset` later. All
 * have as many bytes as their small letters. */
static const struct {
    uint32_t first, last, step, offset;
} capitals[] = {
    { 'A', 'Z', 1, 32 },       { 0x00C0, 0x00DE, 1, 32 }, { 0x0110, 0x0136, 2, 1 },
    { 0x0139, 0x0147, 2, 1 },  { 0x014A, 0x0176, 2, 1 },  { 0x0388, 0x038A, 1, 37 },
    { 0x0391, 0x03A9, 1, 32 }, { 0x0400, 0x040F, 1, 80 }, { 0x0410, 0x042F, 1, 32 },
    { 0x0460, 0x0480, 2, 1 },  { 0x048A, 0x04BE, 2, 1 },  { 0x04D0, 0x052E, 2, 1 },
    { 0x1E00, 0x1E94, 2, 1 },  { 0x1EA0, 0x1EFE, 2, 1 },  { 0xFF21, 0xFF3A, 1, 32 },
};

static uint32_t lower(uint32_t character) {
    if (character == 0xD7) /* the sign × among the letters */
        return character;
    for (size_t i = 0; i < sizeof capitals / sizeof *capitals; i++)
        if (character >= capitals[i].first && character <= capitals[i].last &&
            (character - capitals[i].first) % capitals[i].step == 0)
            return character + capitals[i].offset;
    return character;
}

/* Writes a character with as many bytes as it was read from. */
static void write_character(unsigned char *out, uint32_t character, size_t length) {
    static const unsigned char marks[] = { 0, 0, 0xC0, 0xE0, 0xF0 };
    for (size_t i = length - 1; i > 0; i--, character >>= 6)
        out[i] = (unsigned char)(0x80 | (character & 0x3F));
    out[0] = (unsigned char)(marks[length] | character);
}

void proto_text_fold(char *text) {
    unsigned char *out = (unsigned char *)text;
    size_t length;
    for (const unsigned char *c = out; *c; c += length) {
        const uint32_t character = read_character(c, &length);
        const uint32_t at = character - BASES_FIRST;
        if (character == 0xFFFD) {
            memmove(out, c, length);
            out += length;
        } else if (at < BASES_COUNT && bases[at] != '.') {
            *out++ = (unsigned char)bases[at];
        } else if (character < 0x300 || character > 0x36F) { /* no accent of its own */
            const uint32_t small = lower(character);
            if (length == 1)
                *out = (unsigned char)small;
            else
                write_character(out, small, length);
            out += length;
        }
    }
    *out = 0;
}
