"""Who a late tick belongs to: the kernel's accounts of the loop's thread, and the rule by which they are judged."""
