/* Writes an uncompressed PNG file. */
#ifndef EXAMPLES_PNG_H
#define EXAMPLES_PNG_H

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint32_t png_crc(uint32_t crc, const unsigned char *bytes, size_t count) {
    crc = ~crc;
    for (size_t i = 0; i < count; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) crc = (crc >> 1) ^ (0xEDB88320u & (0u - (crc & 1u)));
    }
    return ~crc;
}

static void png_big_endian(unsigned char *at, uint32_t value) {
    for (int i = 0; i < 4; i++) at[i] = (unsigned char)(value >> (24 - 8 * i));
}

static void png_chunk(FILE *file, const char *type, const unsigned char *bytes, uint32_t count) {
    unsigned char word[4];
    uint32_t crc = png_crc(0, (const unsigned char *)type, 4);
    png_big_endian(word, count);
    fwrite(word, 1, 4, file);
    fwrite(type, 1, 4, file);
    if (count) fwrite(bytes, 1, count, file);
    png_big_endian(word, png_crc(crc, bytes, count));
    fwrite(word, 1, 4, file);
}

/* Writes a picture. `pixels`: rows of 4 bytes for each pixel (red, green, blue, ignored). `pitch`: bytes from one row
 * to the next. Returns 0 on success. */
static int png_write(const char *path, const unsigned char *pixels, uint32_t width, uint32_t height, size_t pitch) {
    const size_t row = 1 + (size_t)width * 3, raw = row * height, block = 65535;
    const size_t blocks = (raw + block - 1) / block;
    unsigned char *data = (unsigned char *)malloc(raw), *zlib = (unsigned char *)malloc(raw + blocks * 5 + 6);
    FILE *file = fopen(path, "wb");
    int ok = file && data && zlib;
    if (ok) {
        static const unsigned char signature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
        unsigned char head[13] = {0, 0, 0, 0, 0, 0, 0, 0, 8, 2, 0, 0, 0}, *out = zlib;
        uint32_t a = 1, b = 0;
        for (uint32_t y = 0; y < height; y++) {
            unsigned char *to = data + row * y;
            *to++ = 0; /* no filter */
            for (uint32_t x = 0; x < width; x++, to += 3) memcpy(to, pixels + pitch * y + 4 * (size_t)x, 3);
        }
        for (size_t i = 0; i < raw; i++) {
            a = (a + data[i]) % 65521;
            b = (b + a) % 65521;
        }
        *out++ = 0x78;
        *out++ = 0x01;
        for (size_t at = 0; at < raw; at += block) { /* stored blocks */
            const size_t n = raw - at < block ? raw - at : block;
            *out++ = at + n == raw;
            *out++ = (unsigned char)n;
            *out++ = (unsigned char)(n >> 8);
            *out++ = (unsigned char)~n;
            *out++ = (unsigned char)(~n >> 8);
            memcpy(out, data + at, n);
            out += n;
        }
        png_big_endian(out, b << 16 | a);
        out += 4;
        png_big_endian(head, width);
        png_big_endian(head + 4, height);
        fwrite(signature, 1, 8, file);
        png_chunk(file, "IHDR", head, 13);
        png_chunk(file, "IDAT", zlib, (uint32_t)(out - zlib));
        png_chunk(file, "IEND", NULL, 0);
        ok = !ferror(file);
    }
    if (file && fclose(file)) ok = 0;
    free(data);
    free(zlib);
    return ok ? 0 : 1;
}

#endif
