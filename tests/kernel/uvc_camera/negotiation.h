/* SPDX-License-Identifier: Apache-2.0 */
/* The probe and commit controls of UVC 1.1 (4.3.1.1): how host and camera agree on a stream. */
#ifndef UVC_CAMERA_NEGOTIATION_H
#define UVC_CAMERA_NEGOTIATION_H

#include <stdint.h>
#include "model.h"

enum { PROBE_BYTES = 34 };

/* What the host and we agree on; the rest of the probe control follows from it. */
struct agreement {
	uint8_t format_index, size_index; /* from 1 */
	uint32_t interval;		  /* 100 ns */
};

/* The offered thing that is nearest to what the host asked for. */
struct agreement negotiate(const uint8_t asked[PROBE_BYTES]);
/* The control's data, which tells the host what follows from the agreement. */
void put_probe(uint8_t data[PROBE_BYTES], const struct agreement *agreement);
const struct camera_size *agreed_size(const struct agreement *agreement);

#endif
