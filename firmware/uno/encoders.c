#include "encoders.h"

#include "board.h"
#include "settings.h"
#include "telemetry.h"

#define FAULT_MS 500
#define DRIVEN_HARD 500 /* per mille: above the dead zone of all tested motors */

uint8_t encoders_fault;
static volatile int32_t counts[2]; /* of each plug */
static volatile int8_t single[2];  /* count of an edge with one channel */
static uint8_t before[2];          /* the pins of each plug at the last edge: B and A */
static uint16_t silent_ms[2];

/* [B A before][B A now]; a change of both is not counted, because its sign is unknown. */
static const int8_t step[16] = {0, 1, -1, 0, -1, 0, 0, 1, 1, 0, 0, -1, 0, -1, 1, 0};

void encoders_edge(uint8_t pins) {
    uint8_t quadrature = settings.encoders == ENCODER_KIND_QUADRATURE;
    for (uint8_t plug = 0; plug < 2; plug++) {
        uint8_t now = (pins & 1) | (pins & 4) >> 1, was = before[plug];
        before[plug] = now;
        pins >>= 1;
        if (quadrature) counts[plug] += step[was << 2 | now];
        else if ((now ^ was) & 1) counts[plug] += single[plug];
    }
}

void encoders_tick(void) {
    uint8_t wiring = settings.wiring;
    encoders_fault = 0;
    for (uint8_t wheel = 0; wheel < 2; wheel++) {
        uint8_t plug = wiring & WIRING_ENCODERS_SWAPPED ? !wheel : wheel;
        int16_t duty = OF_WHEEL(permille, wheel);
        if (settings.encoders == ENCODER_KIND_NONE) single[plug] = 0;
        else if (duty) single[plug] = duty < 0 ? -1 : 1;
        uint8_t was = board_lock();
        int32_t count = counts[plug];
        board_unlock(was);
        if (settings.encoders == ENCODER_KIND_QUADRATURE && wiring & WIRING_LEFT_ENCODER_REVERSED << wheel)
            count = -count;
        int32_t *former_count = &OF_WHEEL(counts, wheel);
        uint8_t strong = duty >= DRIVEN_HARD || duty <= -DRIVEN_HARD;
        if (settings.encoders == ENCODER_KIND_NONE || count != *former_count || !strong) silent_ms[wheel] = 0;
        else if (silent_ms[wheel] < FAULT_MS) silent_ms[wheel]++;
        else encoders_fault = 1;
        *former_count = count;
    }
}
