"""A vision-language model as the reasoner: judging, analysing and planning (Sec. V)."""
