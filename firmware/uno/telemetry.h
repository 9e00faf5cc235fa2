/* The data for the host: each file updates its fields, and protocol.c sends them unchanged. */
#pragma once
#include "frames.h"

extern state_t state;
extern info_t info; /* with the configuration of this session */

/* Left and right are neighbours in the frame. */
#define OF_WHEEL(field, wheel) (&state.left_##field)[wheel]
