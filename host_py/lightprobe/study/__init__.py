"""Studies with people: which AR pictures look real? `lightprobe study`, docs/users/study.md.

* plan: what the researcher writes (TOML): pictures, methods, questions, when answers are left out.
* trials: what each participant is shown, and the study file that fixes all of it.
* page: the page for participants, static, with pictures whose names tell nothing.
* answers: files that the page writes, checked against the study; who is left out, and why.
* statistics: intervals and tests, each with its source.
* analysis: what the answers say, as numbers; report: as text; plot: as a picture.
* simulate: participants that are made up, to test the analysis with.
"""
