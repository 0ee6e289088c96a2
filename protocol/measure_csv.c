/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements as CSV, one per line.
 *
 * Spreadsheets take a field for a formula if it begins with one of = + - @, with their full-width
 * forms, or with blanks and one of these (OWASP, CSV Injection). Such a text gets an apostrophe in
 * front, which spreadsheets take for "this is text". In countries where the semicolon separates
 * fields, a field may begin behind each semicolon, so the same holds there. Numbers keep their
 * sign. A text is between quotes if it has a separator, a quote, or a blank at an end.
 *
 * Why not a library: writing RFC 4180 takes the thirty lines of put_text(), and no CSV library that
 * Debian packages for C neutralises formulas.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/measure.h"

/* Returns the code point at `text` and its bytes; 0 at the end. The text is valid UTF-8. */
static uint32_t code_at(const char *text, unsigned *bytes) {
    const unsigned char *c = (const unsigned char *)text;
    *bytes = c[0] < 0x80 ? 1 : c[0] < 0xe0 ? 2 : c[0] < 0xf0 ? 3 : 4;
    uint32_t code = *bytes == 1 ? c[0] : c[0] & (0x7fu >> *bytes);
    for (unsigned i = 1; i < *bytes; i++) {
        if (!c[i])
            *bytes = i;
        code = code << 6 | (c[i] & 0x3fu);
    }
    return code;
}

/* Blanks and characters without a width, which spreadsheets skip: C0 and C1 controls, spaces, the
 * soft hyphen, joiners, the byte order mark. */
static bool is_blank(uint32_t code) {
    return (code > 0 && code <= 0x20) || (code >= 0x7f && code <= 0xa0) || code == 0xad ||
           code == 0x1680 || code == 0x180e || (code >= 0x2000 && code <= 0x200f) ||
           (code >= 0x2028 && code <= 0x202f) || (code >= 0x205f && code <= 0x206f) ||
           code == 0x3000 || code == 0xfeff;
}

static bool is_sign(uint32_t code) {
    static const uint32_t signs[] = {
        '=',    '+',    '-',    '@',    0x2212, /* the minus sign */
        0xfe62, 0xfe63, 0xfe66, 0xfe6b,         /* small + - = @ */
        0xff0b, 0xff0d, 0xff1d, 0xff20,         /* full-width + - = @ */
    };
    for (unsigned i = 0; i < sizeof signs / sizeof *signs; i++)
        if (code == signs[i])
            return true;
    return false;
}

/* Could a field that begins here be a formula? */
static bool begins_formula(const char *text) {
    unsigned bytes;
    uint32_t code = code_at(text, &bytes);
    if (code == '\t' || code == '\r' || code == '\n')
        return true;
    for (; is_blank(code); code = code_at(text, &bytes))
        text += bytes;
    return is_sign(code);
}

static bool needs_quotes(const char *text) {
    unsigned bytes;
    const size_t length = strlen(text);
    return strpbrk(text, ",;\"\t\r\n") || begins_formula(text) || is_blank(code_at(text, &bytes)) ||
           (length > 0 && text[length - 1] == ' ');
}

/* Writes a field that a person may have written. */
static void put_text(FILE *out, const char *text) {
    const bool is_quoted = needs_quotes(text);
    bool is_field = true; /* the next character could begin a field */
    if (is_quoted)
        fputc('"', out);
    for (; *text; text++) {
        if (is_field && begins_formula(text))
            fputc('\'', out);
        is_field = *text == ';';
        if (*text == '"')
            fputc('"', out);
        fputc(*text, out);
    }
    if (is_quoted)
        fputc('"', out);
}

/* Writes the shortest of the decimals with 15 to 17 digits that reads back as the same double; an
 * empty field if it is not finite. */
static void put_number(FILE *out, double value) {
    char text[32];
    for (int digits = 15; digits <= 17; digits++) {
        snprintf(text, sizeof text, "%.*g", digits, value);
        if (strtod(text, NULL) == value)
            break;
    }
    fputs(isfinite(value) ? text : "", out);
}

/* Writes the range of a part or a path, and what it has besides its value. */
static void put_part(FILE *out, const struct proto_measure *m) {
    const struct sp_measure_result *result = &m->value.result;
    const bool has_range = sp_measure_has_range(m->geometry.kind);
    const bool is_part = m->geometry.kind == SP_MEASURE_PART && result->has_value;
    const bool is_path = m->geometry.kind == SP_MEASURE_PATH && result->has_value;
    for (int end = 0; end < 2; end++) {
        fputc(',', out);
        put_number(out, has_range ? m->geometry.range[end] : NAN);
    }
    fputc(',', out);
    put_number(out, is_part ? result->area : NAN);
    fputc(',', out);
    if (is_part)
        fprintf(out, "%" PRIu64, result->samples);
    fputc(',', out);
    put_number(out, is_path ? result->straight : NAN);
}

static void put_line(FILE *out, const struct proto_measure *m) {
    const struct sp_measure_result *result = &m->value.result;
    const struct sp_statistics *s = &result->statistics;
    char unit[SP_UNIT_BYTES + 2], note[PROTO_MEASURE_NOTE_MAX + 1];
    const double numbers[] = { s->mean, s->deviation, s->min, s->max };
    proto_measure_unit(&m->value, unit);
    proto_measure_note(&m->geometry, &m->value, note);
    put_text(out, m->id);
    fprintf(out, ",%s,", sp_measure_kind_name(m->geometry.kind));
    put_text(out, m->volume);
    fputc(',', out);
    put_text(out, m->text);
    fputc(',', out);
    put_text(out, m->author);
    fprintf(out, ",%s,%s,", m->color, m->is_hidden ? "true" : "false");
    put_number(out, result->has_value ? result->value : NAN);
    fputc(',', out);
    put_text(out, unit);
    if (result->has_statistics)
        fprintf(out, ",%" PRIu64 ",%" PRIu64, s->count, s->nonfinite);
    else
        fputs(",,", out);
    for (unsigned i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        fputc(',', out);
        put_number(out, result->has_statistics && s->count > 0 ? numbers[i] : NAN);
    }
    fputc(',', out);
    put_number(out, result->outside);
    fputc(',', out);
    put_text(out, note);
    for (unsigned i = 0; i < SP_MEASURE_POINTS * 3; i++) {
        fputc(',', out);
        put_number(out, i / 3 < sp_measure_point_count(m->geometry.kind)
                            ? m->geometry.points[i / 3][i % 3]
                            : NAN);
    }
    put_part(out, m);
    fputc(',', out);
    put_text(out, m->value.data_unit);
    fputs("\r\n", out);
}

char *proto_measures_to_csv(const struct proto_measure *measures, size_t count, size_t *size) {
    char *text = NULL;
    FILE *out = open_memstream(&text, size);
    if (!out)
        return NULL;
    fputs("id,kind,volume,text,author,color,hidden,value,unit,count,nonfinite,mean,deviation,min,"
          "max,outside,note,x1,y1,z1,x2,y2,z2,x3,y3,z3,low,high,area,samples,straight,"
          "data_unit\r\n",
          out);
    for (size_t i = 0; i < count; i++)
        put_line(out, &measures[i]);
    const bool has_failed = ferror(out) != 0;
    if (fclose(out) != 0 || has_failed) {
        free(text);
        return NULL;
    }
    return text;
}
