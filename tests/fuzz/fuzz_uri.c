/* SPDX-License-Identifier: Apache-2.0 */
/* A URI, and its query into the options of every back end (nothing is opened). */
#include "fuzz.h"

#include <string.h>

#include "app/backends.h"
#include "base/log.h"
#include "base/uri.h"
#include "include/publisher.h"
#include "include/source.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	const struct lp_source_host source_host = {0};
	const struct lp_publisher_host publisher_host = {0};
	struct lp_publisher *publisher;
	struct lp_source *source;
	char text[LP_URI_MAX_BYTES + 16];
	struct lp_uri uri;

	if (size >= sizeof(text))
		return 0;
	memcpy(text, data, size);
	text[size] = '\0';
	lp_log_set_level(LP_LOG_ERROR);
	if (lp_uri_parse(&uri, text) == 0) {
		fuzz_assert(strlen(uri.rest) < LP_URI_MAX_BYTES);
		fuzz_assert(uri.key_count <= LP_URI_MAX_KEYS);
	}
	if (lp_source_open(text, &source_host, &source) == 0)
		source->ops->destroy(source);
	if (lp_publisher_open(text, &publisher_host, &publisher) == 0)
		publisher->ops->destroy(publisher);
	return 0;
}
