#include "frame.h"

#include <string.h>

#include "board.h"
#include "telemetry.h"

#define LONGEST (1 + 2 + MAX_PAYLOAD + 2) /* one byte of COBS, kind, sequence, payload, CRC */

static uint8_t piece[LONGEST];
static uint8_t filled; /* LONGEST + 1: the frame is too long; wait for the zero */
static uint8_t sent;

uint16_t frame_crc(const uint8_t *bytes, uint8_t length) {
    uint16_t crc = 0xFFFF;
    while (length--) {
        uint8_t x = (uint8_t)(crc >> 8) ^ *bytes++;
        x ^= x >> 4;
        crc = (uint16_t)(crc << 8) ^ (uint16_t)((uint16_t)x << 12) ^ (uint16_t)((uint16_t)x << 5) ^ x;
    }
    return crc;
}

/* Decode in place: the result is one byte shorter, the first distance is removed, the others become zeros. */
static uint8_t unstuff(uint8_t *bytes, uint8_t length) {
    uint8_t in = 0, out = 0;
    while (in < length) {
        uint8_t distance = bytes[in++];
        if (distance > length - in + 1) return 0;
        while (--distance) bytes[out++] = bytes[in++];
        if (in < length) bytes[out++] = 0;
    }
    return out;
}

static const frame_t *whole(void) {
    static frame_t frame;
    if (filled > LONGEST) return 0;
    uint8_t length = unstuff(piece, filled);
    if (length < 4 || frame_crc(piece, length) != 0) return 0; /* the CRC of a text with its CRC is 0 */
    frame = (frame_t){piece[0], piece[1], (uint8_t)(length - 4), piece + 2};
    return &frame;
}

const frame_t *frame_take(uint8_t byte) {
    if (byte) {
        if (filled < LONGEST) piece[filled++] = byte;
        else filled = LONGEST + 1;
        return 0;
    }
    if (!filled) return 0;
    const frame_t *frame = whole();
    if (!frame) info.bad_crc++;
    filled = 0;
    return frame;
}

uint8_t frame_sealed(const frame_t *frame) {
    const uint8_t *byte = frame->payload - 2;
    uint16_t crc = 0;
    for (uint8_t k = frame->length + 2; k; k--) {
        crc ^= (uint16_t)(*byte++ << 8);
        for (uint8_t bit = 0; bit < 8; bit++) crc = crc & 0x8000 ? (uint16_t)(crc << 1) ^ SEAL_POLYNOMIAL : crc << 1;
    }
    return crc == 0;
}

void frame_send(uint8_t kind, const void *payload, uint8_t length) {
    uint8_t wire[LONGEST + 2]; /* a zero, the first distance, the body, a zero */
    uint8_t *body = wire + 2, distance = 0;
    body[0] = kind;
    body[1] = sent++;
    memcpy(body + 2, payload, length);
    length += 2;
    uint16_t crc = frame_crc(body, length);
    body[length++] = (uint8_t)(crc >> 8);
    body[length++] = (uint8_t)crc;
    wire[0] = wire[1] = body[length] = 0;
    for (uint8_t *at = body + length; at != wire; at--, distance++) {
        if (*at) continue;
        *at = distance; /* to the next zero; 0 at the end itself */
        distance = 0;
    }
    board_send(wire, length + 3);
}
