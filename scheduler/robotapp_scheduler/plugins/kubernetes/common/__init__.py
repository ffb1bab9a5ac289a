"""What plugins of several kinds read: releases, arguments, node selectors."""
