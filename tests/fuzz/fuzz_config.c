/* SPDX-License-Identifier: Apache-2.0 */
/* A configuration file. */
#include "fuzz.h"

#include "app/options/options.h"
#include "base/log.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct lp_options options;

	lp_log_set_level(LP_LOG_ERROR);
	lp_options_defaults(&options);
	(void)lp_options_read_config(&options, "fuzz", (const char *)data, size);
	fuzz_assert(options.publish.count >= 0 && options.publish.count <= LP_MAX_PUBLISHERS);
	fuzz_assert(options.lights >= 0 && options.lights <= LP_MAX_LIGHTS);
	fuzz_assert(options.sh_order >= 0 && options.sh_order <= LP_MAX_SH_ORDER);
	fuzz_assert(options.ttl_ms >= 10 && options.smoothing_ms >= 0);
	return 0;
}
