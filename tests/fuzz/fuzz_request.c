/* SPDX-License-Identifier: Apache-2.0 */
/* What a client may send: framing, then the request, as the socket publisher takes them. */
#include "fuzz.h"

#include "drivers/publisher/framing.h"
#include "include/publisher.h"
#include "serve/codec/codec.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	size_t offset, length;

	while (lp_framing_next(data, size, LP_REQUEST_MAX_BYTES, &offset, &length) == 1) {
		struct lp_request request;
		const char *reason;

		fuzz_assert(offset + length <= size);
		if (lp_decode_request(data + offset, length, &request, &reason) == 0 &&
		    request.kind == LP_REQUEST_SUBSCRIBE) {
			const struct lp_subscription wanted = request.subscription;

			fuzz_assert(wanted.rate_hz >= 0 && wanted.tolerance >= 0);
			fuzz_assert(wanted.sh_order >= 0 && wanted.sh_order <= LP_MAX_SH_ORDER);
			fuzz_assert(wanted.max_lights >= 0 && wanted.max_lights <= LP_MAX_LIGHTS);
		}
		data += offset + length;
		size -= offset + length;
	}
	return 0;
}
