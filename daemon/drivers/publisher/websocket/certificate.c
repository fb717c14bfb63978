/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/websocket/certificate.h"

#include <errno.h>

int lp_certificate_begin(struct lp_certificate *certificate, const char *object, const char *folder)
{
	int ret;

	*certificate = (struct lp_certificate){.object = object, .folder = folder};
	certificate->read = certificate->seen = lp_pair_stamp(folder);
	ret = lp_pair_read(&certificate->pair, object, folder);
	certificate->is_valid = ret == 0;
	return ret == -EAGAIN ? 0 : ret;
}

bool lp_certificate_look(struct lp_certificate *certificate)
{
	const struct lp_pair_stamp now = lp_pair_stamp(certificate->folder);
	const bool is_written = !lp_pair_stamps_are_same(&now, &certificate->seen);
	struct lp_pair pair;

	certificate->seen = now;
	if (is_written) /* maybe not all of it yet */
		return false;
	if (certificate->is_valid && lp_pair_stamps_are_same(&now, &certificate->read))
		return false;
	certificate->read = now;
	if (lp_pair_read(&pair, certificate->object, certificate->folder) < 0)
		return false;
	lp_pair_finish(&certificate->pair);
	certificate->pair = pair;
	certificate->is_valid = true;
	return true;
}

void lp_certificate_finish(struct lp_certificate *certificate)
{
	lp_pair_finish(&certificate->pair);
}
