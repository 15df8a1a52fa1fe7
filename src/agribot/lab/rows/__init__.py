"""Networks judged on photographs whose crop rows are labelled as lines."""
