"""The course's examiner: what a student's detector or node does otherwise than the sheet, and which mistake that is."""
