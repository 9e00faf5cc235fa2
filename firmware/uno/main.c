/* Drive two motors with an Arduino Uno. README.md lists the requirements; no Arduino library is used. */
#include "board.h"
#include "encoders.h"
#include "mark.h"
#include "motors.h"
#include "protocol.h"
#include "settings.h"

int main(void) {
    board_begin();
    settings_begin();
    motors_begin();
    board_live();
    protocol_begin();
    for (;;) {
        uint8_t byte;
        while (board_take(&byte)) protocol_take(byte);
        if (board_tick()) {
            motors_tick();
            encoders_tick();
            mark_tick();
            protocol_tick();
        } else {
            board_sleep();
        }
    }
}
