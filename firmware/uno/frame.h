/* Frames of any kind on the wire: COBS, CRC-16/CCITT-FALSE, a zero at both ends. */
#pragma once
#include <stdint.h>

typedef struct {
    uint8_t kind, seq, length;
    const uint8_t *payload;
} frame_t;

uint16_t frame_crc(const uint8_t *bytes, uint8_t length);
const frame_t *frame_take(uint8_t byte); /* returns the frame that ends with this byte, or 0 */
uint8_t frame_sealed(const frame_t *frame); /* 1: the payload ends with a valid second CRC */
void frame_send(uint8_t kind, const void *payload, uint8_t length);
