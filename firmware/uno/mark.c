#include "mark.h"

#include "board.h"
#include "settings.h"
#include "telemetry.h"

#define STRIP_MS 2 /* a shorter strip is a glitch */
#define GONE_MS 20 /* time over the floor before the next strip counts */

uint8_t mark_on;
static volatile uint32_t edge_t_us;
static volatile uint8_t edge; /* a strip begins at edge_t_us; not yet confirmed */
static uint8_t ms = GONE_MS;
static uint8_t ready; /* 1: the floor was detected. An open pin reads as a strip without an end, and never counts */

static uint8_t over(uint8_t level) { return settings.wiring & WIRING_MARK_ACTIVE_LOW ? !level : level; }

void mark_edge(uint8_t level) {
    if (!edge && over(level)) {
        edge_t_us = board_micros();
        edge = 1;
    }
}

void mark_tick(void) {
    uint8_t was = board_lock(); /* a later edge is kept for the next tick */
    mark_on = over(board_mark());
    if (!mark_on) edge = 0;
    board_unlock(was);
    if (!ready) {
        ms = mark_on ? GONE_MS : ms - 1;
        ready = !ms;
    } else if (!mark_on || !edge) {
        ms = 0;
    } else if (++ms == STRIP_MS) {
        state.mark_count++;
        state.mark_t_us = edge_t_us;
        ready = 0;
        ms = GONE_MS;
    }
}
