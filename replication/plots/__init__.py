"""Every figure; `style` holds every colour."""
