# SPDX-License-Identifier: Apache-2.0
# Pages with generated parts: the fault pages, panel.md and others.

.PHONY: faults-docs check-faults
faults-docs: build ## write the generated parts of the fault pages in docs/ again
	@$(VENV)/bin/python docs/faults.py
.PHONY: which-camera
which-camera: build ## measure the simulated THETA X again and write docs/users/which_camera.md (four minutes)
	@$(VENV)/bin/python tests/bench/which_camera.py

.PHONY: docs-old
docs-old: $(STAMPS)/venv ## name the generated parts of pages that are older than what they measure, and what writes them
	@$(VENV)/bin/python docs/generated.py

.PHONY: panel-docs
panel-docs: build ## write the tables of docs/users/panel.md again
	@$(VENV)/bin/python docs/panel.py

check-rules: check-faults
check-faults: build
	@$(VENV)/bin/python docs/faults.py --check
	@$(VENV)/bin/python docs/panel.py --check
