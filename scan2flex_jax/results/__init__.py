"""Results of `fit` and `explain`: records, what they rest on (`influence`), and the sentences that say them."""
